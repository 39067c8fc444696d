//! Theorems 2.1 to 2.6 of Kida 1993 on 200 random structures, against transmission zeros by their definition.

use fuyu_structures::{FemModel, HybridModel, Matrices};
use nalgebra::{Complex, DMatrix};

use crate::{
    random::Random,
    support::{upper, worst_root},
};

/// A system `M q'' + C q' + K q = L u`, `y = H q`.
struct System {
    M: DMatrix<f64>,
    C: DMatrix<f64>,
    K: DMatrix<f64>,
    L: DMatrix<f64>,
    H: DMatrix<f64>,
}

impl System {
    /// Transmission zeros by definition 2.3: where Rosenbrock's matrix `[A - s B; C 0]` loses rank. Its finite generalized eigenvalues are found by
    /// inverting the pencil at a shift, which knows nothing of the structure: q, q' and u are unknowns alike.
    fn zeros(&self, count: usize, scale: f64) -> Vec<Complex<f64>> {
        let (n, r) = (self.M.nrows(), self.L.ncols());
        let size = 2 * n + r;
        let (mut E, mut F) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        E.view_mut((0, 0), (n, n)).fill_with_identity();
        E.view_mut((n, n), (n, n)).copy_from(&self.M);
        F.view_mut((0, n), (n, n)).fill_with_identity();
        F.view_mut((n, 0), (n, n)).copy_from(&-&self.K);
        F.view_mut((n, n), (n, n)).copy_from(&-&self.C);
        F.view_mut((n, 2 * n), (n, r)).copy_from(&self.L);
        F.view_mut((2 * n, 0), (r, n)).copy_from(&self.H);
        // F x = s E x; with s = σ + 1/ν: (F - σ E)⁻¹ E x = ν x. Zeros at infinity have ν = 0.
        let shift = 0.37 * scale;
        let shifted = &F - &E * shift;
        let inverse = shifted.lu().solve(&E).expect("the shift is not a zero");
        let mut values: Vec<Complex<f64>> = inverse.complex_eigenvalues().iter().copied().collect();
        values.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
        // Zeros at infinity have ν = 0 in chains of up to three, which rounding makes 1e-5 of the largest one.
        assert!(
            values.len() == count || values[count].norm() < 0.1 * values[count - 1].norm(),
            "{values:?}"
        );
        values.truncate(count);
        values.into_iter().map(|nu| shift + 1.0 / nu).collect()
    }

    /// How close Rosenbrock's matrix is to losing rank at `s`: smallest singular value of its polynomial form over that at a
    /// point nearby.
    fn rank_loss(&self, s: Complex<f64>) -> f64 {
        let least = |s: Complex<f64>| {
            let (n, r) = (self.M.nrows(), self.L.ncols());
            let mut P = DMatrix::zeros(n + r, n + r);
            let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
            let polynomial = complex(&self.M) * (s * s) + complex(&self.C) * s + complex(&self.K);
            P.view_mut((0, 0), (n, n)).copy_from(&polynomial);
            P.view_mut((0, n), (n, r)).copy_from(&complex(&self.L));
            P.view_mut((n, 0), (r, n)).copy_from(&complex(&self.H));
            P.singular_values().min()
        };
        least(s) / least(s * Complex::new(1.0 + 1e-3, 1e-3))
    }

    fn check(&self, found: &[Complex<f64>], what: &str) -> f64 {
        let scale = found.iter().map(|s| s.norm()).fold(0.0, f64::max);
        for s in found {
            let loss = self.rank_loss(*s);
            assert!(loss < 1e-7, "{what}: {s} is no zero: {loss:e}");
        }
        let error = worst_root(found, &self.zeros(found.len(), scale));
        assert!(error < 1e-6, "{what}: {error:e}\n{found:?}");
        error
    }
}

// Theorems 2.1 and 2.2. The second is given all modes, so both are exact; damping ratios make D the modes'.
#[test]
fn zeros_of_fem_and_modal_models_are_those_of_the_definition() {
    let mut random = Random::new(20);
    let mut worst = [0.0_f64; 2];
    for trial in 0..200 {
        let (n, r) = (random.count(3, 8), random.count(1, 2));
        let M = random.definite(n, 0.5);
        let K = random.definite(n, 0.5) * 10.0;
        let eigen = fuyu_structures::generalized_eigen(&K, &M).unwrap();
        let ratios: Vec<f64> = (0..n).map(|_| random.between(0.0, 0.05)).collect();
        // D = M Φ 2ZΣ Φᵀ M.
        let modal = DMatrix::from_fn(n, n, |i, j| {
            if i == j {
                2.0 * ratios[i] * eigen.values[i].sqrt()
            } else {
                0.0
            }
        });
        let MPhi = &M * &eigen.vectors;
        let D = &MPhi * modal * MPhi.transpose();
        let D = (&D + D.transpose()) / 2.0;
        let mut model = FemModel::collocated(
            Matrices::new(M.clone(), K.clone()).unwrap(),
            D.clone(),
            &[0],
        )
        .unwrap();
        model.L = random.matrix(n, r);
        let system = System {
            M,
            C: D,
            K,
            L: model.L.clone(),
            H: model.L.transpose(),
        };
        let zeros = model.zeros().unwrap();
        assert_eq!(zeros.len(), 2 * (n - r), "{trial}");
        worst[0] = worst[0].max(system.check(&zeros, &format!("theorem 2.1, trial {trial}")));
        // Property 2.2: the system is of minimum phase.
        assert!(zeros.iter().all(|s| s.re < 1e-9 * s.norm()), "{zeros:?}");
        let modal = model.modal(&ratios, n).unwrap().zeros().unwrap();
        let error = worst_root(&modal, &zeros);
        assert!(error < 1e-8, "theorem 2.2, trial {trial}: {error:e}");
        worst[1] = worst[1].max(error);
    }
    println!(
        "theorem 2.1 against the pencil {:.1e}, theorem 2.2 against 2.1 {:.1e}",
        worst[0], worst[1]
    );
}

/// A hybrid model with its matrices.
fn hybrid(random: &mut Random) -> (HybridModel, usize, usize) {
    let (r, n) = (random.count(1, 3), random.count(1, 5));
    // N^c must be positive definite: the flexible parts are inside of J.
    let P = random.matrix(n, r);
    let J = random.definite(r, 0.3) + P.transpose() * &P;
    let frequencies: Vec<f64> = (0..n).map(|_| random.between(0.5, 6.0)).collect();
    let ratios: Vec<f64> = (0..n).map(|_| random.between(0.001, 0.05)).collect();
    (HybridModel::new(J, P, &frequencies, &ratios).unwrap(), r, n)
}

fn system(model: &HybridModel, L: DMatrix<f64>, H: DMatrix<f64>) -> System {
    let [M, C, K] = model.matrices();
    System { M, C, K, L, H }
}

/// `[left right]` or its transpose.
fn joined(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut whole = DMatrix::zeros(left.nrows(), left.ncols() + right.ncols());
    whole.columns_mut(0, left.ncols()).copy_from(left);
    whole
        .columns_mut(left.ncols(), right.ncols())
        .copy_from(right);
    whole
}

// Theorems 2.3 and 2.4: collocated.
#[test]
fn poles_and_zeros_of_hybrid_models_are_those_of_the_definition() {
    let mut random = Random::new(21);
    let mut worst = [0.0_f64; 4];
    for trial in 0..200 {
        let (model, r, n) = hybrid(&mut random);
        let rigid = joined(&DMatrix::identity(r, r), &DMatrix::zeros(r, n));
        let system = system(&model, rigid.transpose(), rigid);
        let (zeros, unconstrained) = (model.zeros().unwrap(), model.unconstrained().unwrap());
        worst[0] = worst[0].max(system.check(&zeros, &format!("theorem 2.3(b), trial {trial}")));
        let error = worst_root(&unconstrained.zeros().unwrap(), &zeros);
        assert!(error < 1e-9, "theorem 2.4(b), trial {trial}: {error:e}");
        worst[1] = worst[1].max(error);
        // Poles: eigenvalues of the state matrix of the whole, 2 n_0 of which are zero.
        let whole = system.M.nrows();
        let mut A = DMatrix::zeros(2 * whole, 2 * whole);
        A.view_mut((0, whole), (whole, whole)).fill_with_identity();
        let inverse = system.M.clone().try_inverse().unwrap();
        A.view_mut((whole, 0), (whole, whole))
            .copy_from(&(-&inverse * &system.K));
        A.view_mut((whole, whole), (whole, whole))
            .copy_from(&(-&inverse * &system.C));
        let mut expected: Vec<_> = A.complex_eigenvalues().iter().copied().collect();
        expected.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
        expected.truncate(2 * n);
        let poles = model.poles().unwrap();
        let error = worst_root(&poles, &expected);
        assert!(error < 1e-8, "theorem 2.3(a), trial {trial}: {error:e}");
        worst[2] = worst[2].max(error);
        let error = worst_root(&unconstrained.poles().unwrap(), &poles);
        assert!(error < 1e-9, "theorem 2.4(a), trial {trial}: {error:e}");
        worst[3] = worst[3].max(error);
        // Property 2.4: minimum phase. Property of (2.8): Φ₁ Φ₁ᵀ = J⁻¹, and the whole transformation is M-orthonormal.
        assert!(zeros.iter().all(|s| s.re < 0.0));
        let u = &unconstrained;
        let mut Phi = DMatrix::zeros(whole, whole);
        Phi.view_mut((0, 0), (r, r)).copy_from(&u.Phi_1);
        Phi.view_mut((0, r), (r, n)).copy_from(&u.Phi_2);
        Phi.view_mut((r, r), (n, n)).copy_from(&u.Phi_3);
        let identity = Phi.transpose() * &system.M * &Phi - DMatrix::identity(whole, whole);
        assert!(
            identity.amax() < 1e-10,
            "trial {trial}: {:e}",
            identity.amax()
        );
    }
    println!("2.3(b), 2.4(b), 2.3(a), 2.4(a): {worst:?}");
}

// Theorem 2.4(b) with the diagonal of the modal damping only, as the book writes it, is not exact: the misprint-like restriction that
// `UnconstrainedModel::damping` documents.
#[test]
fn zeros_from_unconstrained_modes_need_the_full_damping_matrix() {
    let mut random = Random::new(22);
    let mut worst = 0.0_f64;
    for _ in 0..20 {
        let (model, _, n) = hybrid(&mut random);
        let mut unconstrained = model.unconstrained().unwrap();
        unconstrained.damping = DMatrix::from_diagonal(&unconstrained.damping.diagonal());
        if n > 1 {
            worst = worst.max(worst_root(
                &unconstrained.zeros().unwrap(),
                &model.zeros().unwrap(),
            ));
        }
    }
    assert!(worst > 1e-3, "{worst:e}");
}

// Theorems 2.5 and 2.6: sensors or actuators on the flexible part. Zeros may be unstable.
#[test]
fn zeros_of_non_collocated_models_are_those_of_the_definition() {
    let mut random = Random::new(23);
    let (mut worst, mut unstable) = ([0.0_f64; 4], 0);
    for trial in 0..200 {
        let (model, r, n) = hybrid(&mut random);
        let flexible = random.matrix(r, n);
        let H_r = random.matrix(r, r) * 0.3 + DMatrix::identity(r, r);
        let rigid = joined(&DMatrix::identity(r, r), &DMatrix::zeros(r, n));
        let unconstrained = model.unconstrained().unwrap();

        let zeros = model.zeros_measured_elsewhere(&H_r, &flexible).unwrap();
        let measured = system(&model, rigid.transpose(), joined(&H_r, &flexible));
        worst[0] = worst[0].max(measured.check(&zeros, &format!("theorem 2.5(a), trial {trial}")));
        let error = worst_root(
            &unconstrained
                .zeros_measured_elsewhere(&H_r, &flexible)
                .unwrap(),
            &zeros,
        );
        assert!(error < 1e-7, "theorem 2.5(b), trial {trial}: {error:e}");
        worst[1] = worst[1].max(error);
        unstable += usize::from(zeros.iter().any(|s| s.re > 1e-6 * s.norm()));

        let zeros = model
            .zeros_driven_elsewhere(&H_r.transpose(), &flexible.transpose())
            .unwrap();
        let driven = system(&model, joined(&H_r, &flexible).transpose(), rigid);
        worst[2] = worst[2].max(driven.check(&zeros, &format!("theorem 2.6(a), trial {trial}")));
        let right = unconstrained
            .zeros_driven_elsewhere(&H_r.transpose(), &flexible.transpose())
            .unwrap();
        let error = worst_root(&right, &zeros);
        assert!(error < 1e-7, "theorem 2.6(b), trial {trial}: {error:e}");
        worst[3] = worst[3].max(error);
    }
    println!(
        "2.5(a), 2.5(b), 2.6(a), 2.6(b): {worst:?}; {unstable} of 200 are not of minimum phase"
    );
    // Property 2.5: minimum phase is not guaranteed.
    assert!(unstable > 20, "{unstable}");
}

// Only deformation is damped: poles of a free structure without its rigid-body poles.
#[test]
fn a_free_structure_has_its_elastic_poles() {
    let truss = fuyu_structures::kida1993::truss();
    let matrices = truss.matrices().unwrap();
    let D = &matrices.K * 1e-4;
    let model = FemModel::collocated(matrices.clone(), D, &[1, 4, 11]).unwrap();
    let poles = model.poles().unwrap();
    assert_eq!(poles.len(), 18);
    let w = matrices.modes(&[], 12).unwrap().frequencies;
    for (pole, w) in upper(&poles).iter().zip(w.iter().skip(3)) {
        // 2 ζ ω = 1e-4 ω².
        assert!(
            (pole.norm() / w - 1.0).abs() < 1e-9
                && (pole.re / (-0.5e-4 * w * w) - 1.0).abs() < 1e-8,
            "{pole} {w}"
        );
    }
    let wrong = FemModel::collocated(matrices, DMatrix::identity(12, 12), &[0]).unwrap();
    assert!(
        wrong
            .poles()
            .unwrap_err()
            .to_string()
            .contains("not zero for rigid-body motion")
    );
    assert!(
        wrong.zeros().is_err(),
        "one input leaves two rigid-body motions free"
    );
}

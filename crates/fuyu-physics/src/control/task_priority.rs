//! Several tasks for one set of joints, in order of priority.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector6};

/// Jacobian rows of a task: six for a pose. Unused rows are zero.
pub type Rows = Matrix6xX<f64>;

/// Joint efforts for several tasks with strict priority: each task is fulfilled as far as the previous ones allow.
///
/// A task is `J q̈ = b` for the acceleration that efforts add to the free motion, `q̈ = Ĥ⁻¹ τ`. With `Ĥ = L Lᵀ` and `z
/// = L⁻¹ τ` that is `J L⁻ᵀ z = b`, and `zᵀ z = τᵀ Ĥ⁻¹ τ` is the cost of the efforts by Gauss's principle of least
/// constraint. Each task is solved in the null space of the previous ones, by least squares in this metric:
///
/// ```text
/// B = J L⁻ᵀ N,   z += B⁺ (b - J L⁻ᵀ z),   N becomes N - B⁺ B
/// ```
///
/// For one task `τ = L z` is Khatib's operational-space law, `τ = Jᵀ Λ b` with the generalized inertia
/// `Λ = (J Ĥ⁻¹ Jᵀ)⁻¹`, and later tasks act in the null space of its dynamically consistent inverse
/// (O. Khatib, A unified approach for motion and force control of robot manipulators, IEEE J. Robotics and
/// Automation 3, 1987); the recursion is that of B. Siciliano and J.-J. Slotine (ICAR 1991).
///
/// Rows are scaled to unit length, so that metres and radians, heavy and light directions have equal weight. `B⁺` is
/// the pseudo-inverse, damped in directions whose singular value `σ` is below `damping` (A. Maciejewski and C. Klein,
/// J. Robotic Systems 5, 1988): `σ / (σ² + λ²)` with `λ² = damping² - σ²`, at most `1 / damping`. It is exact away from
/// kinematic singularities and from conflicts of tasks (algorithmic singularities).
#[derive(Debug, Clone)]
pub struct TaskPriority {
    /// Singular value below which a direction is damped, for rows of unit length.
    pub damping: f64,
    /// `L`, lower triangle.
    factor: DMatrix<f64>,
    levels: Vec<Level>,
    used: usize,
    z: DVector<f64>,
    row: DVector<f64>,
}

/// A task that has been solved.
#[derive(Debug, Clone)]
struct Level {
    /// `B`.
    rows: Rows,
    /// `(B Bᵀ)⁻¹`, damped.
    inverse: Matrix6<f64>,
}

/// Default damping: efforts are at most some ten times those of a single task far from singularities.
pub(super) const TASK_DAMPING: f64 = 0.1;

impl TaskPriority {
    /// Scratch for at most `tasks` tasks of a robot with `joints` joints. Only this function allocates memory.
    pub fn new(joints: usize, tasks: usize) -> Self {
        let level = Level {
            rows: Rows::zeros(joints),
            inverse: Matrix6::zeros(),
        };
        Self {
            damping: TASK_DAMPING,
            factor: DMatrix::zeros(joints, joints),
            levels: vec![level; tasks],
            used: 0,
            z: DVector::zeros(joints),
            row: DVector::zeros(joints),
        }
    }

    /// Removes all tasks, and sets the reduced inertia `Ĥ` of the present position.
    pub fn begin(&mut self, inertia: &DMatrix<f64>) {
        factorize(inertia, &mut self.factor);
        self.z.fill(0.0);
        self.used = 0;
    }

    /// Adds the next task: rows `J`, zero where unused, and accelerations `b` in addition to those of the free motion.
    ///
    /// # Panics
    /// If there are more tasks than were passed to [`TaskPriority::new`].
    pub fn add(&mut self, J: &Rows, b: &Vector6<f64>) {
        let (earlier, rest) = self.levels.split_at_mut(self.used);
        let level = &mut rest[0];
        let mut residual = *b;
        for (i, row) in J.row_iter().enumerate() {
            self.row.tr_copy_from(&row);
            self.factor.solve_lower_triangular_mut(&mut self.row);
            let length = self.row.norm();
            if length > 0.0 {
                self.row /= length;
                residual[i] = residual[i] / length - self.row.dot(&self.z);
            } else {
                residual[i] = 0.0;
            }
            earlier
                .iter()
                .for_each(|level| level.remove_component(&mut self.row));
            level.rows.row_mut(i).tr_copy_from(&self.row);
        }
        level.invert(self.damping);
        self.z
            .gemv_tr(1.0, &level.rows, &(level.inverse * residual), 1.0);
        self.used += 1;
    }

    /// Projects `y` into the null space of all tasks, in the coordinates `Lᵀ q̇`: joint rates if the inertia is the identity.
    pub fn project_to_null_space(&self, y: &mut DVector<f64>) {
        for level in &self.levels[..self.used] {
            level.remove_component(y);
        }
    }

    /// Adds the part of the efforts `τ_0` \[N m or N\] that does not disturb any of the tasks.
    pub fn add_in_null_space(&mut self, efforts: &DVector<f64>) {
        self.row.copy_from(efforts);
        self.factor.solve_lower_triangular_mut(&mut self.row);
        for level in &self.levels[..self.used] {
            level.remove_component(&mut self.row);
        }
        self.z += &self.row;
    }

    /// Writes the joint accelerations `Ĥ⁻¹ τ = L⁻ᵀ z` \[rad/s² or m/s²\] due to the efforts of all tasks.
    pub fn accelerations(&self, out: &mut DVector<f64>) {
        out.copy_from(&self.z);
        self.factor.tr_solve_lower_triangular_mut(out);
    }

    /// Writes the joint efforts `τ = L z` \[N m or N\] of all tasks.
    pub fn efforts(&self, out: &mut DVector<f64>) {
        for i in 0..out.len() {
            out[i] = (0..=i).map(|k| self.factor[(i, k)] * self.z[k]).sum();
        }
    }
}

impl Level {
    /// Computes the damped inverse of `B Bᵀ`; zero in directions that have no length, and where `B` is not finite.
    fn invert(&mut self, damping: f64) {
        self.inverse.fill(0.0);
        let mut square = Matrix6::zeros();
        for column in self.rows.column_iter() {
            square.ger(1.0, &column, &column, 1.0);
        }
        if !square.iter().all(|x| x.is_finite()) {
            return;
        }
        let Some(eigen) = square.try_symmetric_eigen(1e-14, 200) else {
            return;
        };
        for (direction, eigenvalue) in eigen.eigenvectors.column_iter().zip(&eigen.eigenvalues) {
            // 1 / (σ² + λ²) is constant below the threshold.
            let gain = 1.0 / eigenvalue.max(damping * damping);
            if *eigenvalue > ZERO_LENGTH {
                self.inverse.ger(gain, &direction, &direction, 1.0);
            }
        }
    }

    /// Removes the component of `y` along the rows of this task.
    fn remove_component(&self, y: &mut DVector<f64>) {
        let along = self.inverse * (&self.rows * &*y);
        y.gemv_tr(-1.0, &self.rows, &along, 1.0);
    }
}

/// Writes the lower triangle `L` of `inertia = L Lᵀ`.
pub(super) fn factorize(inertia: &DMatrix<f64>, factor: &mut DMatrix<f64>) {
    let n = inertia.nrows();
    for j in 0..n {
        for i in j..n {
            let known: f64 = (0..j).map(|k| factor[(i, k)] * factor[(j, k)]).sum();
            let left = inertia[(i, j)] - known;
            // Positive for every physical model.
            factor[(i, j)] = if i == j {
                left.sqrt()
            } else {
                left / factor[(j, j)]
            };
        }
    }
}

/// Squared length below which a direction is rounding error.
const ZERO_LENGTH: f64 = 1e-20;

//! Several tasks for one set of joints, the more important first.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector6};

/// Rows of a task: a pose has six. Those that a task leaves out are zero.
pub type Rows = Matrix6xX<f64>;

/// Joint efforts that accelerate several things as wanted, each as far as those before it leave room.
///
/// A task says `J q̈ = b` for what efforts add to the free motion, `q̈ = Ĥ⁻¹ τ`. With `Ĥ = L Lᵀ` and `z = L⁻¹ τ` that is
/// `J L⁻ᵀ z = b`, and `zᵀ z = τᵀ Ĥ⁻¹ τ` is what the efforts cost by Gauss's principle of least constraint. Each task is
/// solved in the space that those before it leave free, by least squares in this metric:
///
/// ```text
/// B = J L⁻ᵀ N,   z += B⁺ (b - J L⁻ᵀ z),   N becomes N - B⁺ B
/// ```
///
/// For one task `τ = L z` is Khatib's operational-space law, `τ = Jᵀ Λ b` with the generalized inertia
/// `Λ = (J Ĥ⁻¹ Jᵀ)⁻¹`, and what follows acts in the null space of its dynamically consistent inverse
/// (O. Khatib, A unified approach for motion and force control of robot manipulators, IEEE J. Robotics and
/// Automation 3, 1987); the recursion is that of B. Siciliano and J.-J. Slotine (ICAR 1991).
///
/// Rows are scaled to unit length, so that metres and radians, heavy and light directions count alike. `B⁺` is the
/// pseudo-inverse with directions damped whose singular value `σ` is below `damping` (A. Maciejewski and C. Klein, J. Robotic
/// Systems 5, 1988): `σ / (σ² + λ²)` with `λ² = damping² - σ²`, no more than `1 / damping`, and exact where the robot is not
/// near a singularity of its own or of the tasks' conflict.
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

/// Efforts stay within some ten times what a task takes alone and far from singularities.
pub const TASK_DAMPING: f64 = 0.1;

impl TaskPriority {
    /// For at most `tasks` tasks of a robot with `joints` joints; the only place where memory is taken.
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

    /// Begins anew with the reduced inertia `Ĥ` of the present position.
    pub fn begin(&mut self, inertia: &DMatrix<f64>) {
        factorize(inertia, &mut self.factor);
        self.z.fill(0.0);
        self.used = 0;
    }

    /// The next task: rows `J`, zero where the task leaves one out, and accelerations `b` beyond those of the free
    /// motion.
    ///
    /// # Panics
    /// If there are more tasks than were announced.
    pub fn add(&mut self, J: &Rows, b: &Vector6<f64>) {
        let (earlier, rest) = self.levels.split_at_mut(self.used);
        let level = &mut rest[0];
        let mut off = *b;
        for (i, row) in J.row_iter().enumerate() {
            self.row.tr_copy_from(&row);
            self.factor.solve_lower_triangular_mut(&mut self.row);
            let length = self.row.norm();
            if length > 0.0 {
                self.row /= length;
                off[i] = off[i] / length - self.row.dot(&self.z);
            } else {
                off[i] = 0.0;
            }
            earlier
                .iter()
                .for_each(|level| level.take_off(&mut self.row));
            level.rows.row_mut(i).tr_copy_from(&self.row);
        }
        level.invert(self.damping);
        self.z
            .gemv_tr(1.0, &level.rows, &(level.inverse * off), 1.0);
        self.used += 1;
    }

    /// Takes off `y` all that the tasks have use of, in the coordinates `Lᵀ q̇`: joint rates if the inertia is one.
    pub fn take_off(&self, y: &mut DVector<f64>) {
        for level in &self.levels[..self.used] {
            level.take_off(y);
        }
    }

    /// Adds the efforts `τ_0` \[N m or N\] as far as they disturb none of the tasks.
    pub fn add_in_null_space(&mut self, efforts: &DVector<f64>) {
        self.row.copy_from(efforts);
        self.factor.solve_lower_triangular_mut(&mut self.row);
        for level in &self.levels[..self.used] {
            level.take_off(&mut self.row);
        }
        self.z += &self.row;
    }

    /// Writes the joint accelerations `Ĥ⁻¹ τ = L⁻ᵀ z` \[rad/s² or m/s²\] that the efforts of all tasks make.
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
    /// Inverts `B Bᵀ`; a direction without length has no part in it, nor has what is not finite.
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
        for (direction, size) in eigen.eigenvectors.column_iter().zip(&eigen.eigenvalues) {
            // 1 / (σ² + λ²) is even below the threshold.
            let gain = 1.0 / size.max(damping * damping);
            if *size > LENGTHLESS {
                self.inverse.ger(gain, &direction, &direction, 1.0);
            }
        }
    }

    /// Takes off `y` what this task has use of.
    fn take_off(&self, y: &mut DVector<f64>) {
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

/// Square of a length that is nothing but rounding.
const LENGTHLESS: f64 = 1e-20;

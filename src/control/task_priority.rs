//! Several tasks for one set of joints, the more important first.

use nalgebra::{Cholesky, DMatrix, DVector, Matrix6, Matrix6xX, U6, Vector6};

/// Rows of a task: a pose has six. Those that a task leaves out are zero.
pub type Rows = Matrix6xX<f64>;

/// Joint efforts that accelerate several things as wanted, each as far as those before it leave room.
///
/// A task says `J q̈ = b` for what efforts add to the free motion, `q̈ = Ĥ⁻¹ τ`. With `Ĥ = L Lᵀ` and `z = L⁻¹ τ` that is
/// `J L⁻ᵀ z = b`, and `zᵀ z = τᵀ Ĥ⁻¹ τ` is what the efforts cost by Gauss's principle of least constraint. Each task is
/// solved in the space that those before it leave free, by least squares in this metric:
///
/// ```text
/// B = N J L⁻ᵀ,   z += Bᵀ (B Bᵀ + λ²)⁻¹ (b - J L⁻ᵀ z),   N becomes N - Bᵀ (B Bᵀ + λ²)⁻¹ B
/// ```
///
/// For one task `τ = L z` is Khatib's operational-space law, `τ = Jᵀ Λ b` with the generalized inertia
/// `Λ = (J Ĥ⁻¹ Jᵀ)⁻¹`, and what follows acts in the null space of its dynamically consistent inverse
/// (O. Khatib, A unified approach for motion and force control of robot manipulators, IEEE J. Robotics and
/// Automation 3, 1987); the recursion is that of B. Siciliano and J.-J. Slotine (ICAR 1991). Rows are scaled to unit
/// length, so that metres and radians, heavy and light directions are damped alike.
#[derive(Debug, Clone)]
pub struct TaskPriority {
    /// Damping `λ` of a row of unit length: near a singularity, efforts stay below `1 / 2λ` of what the task alone
    /// would take.
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
    factor: Option<Cholesky<f64, U6>>,
}

/// Damping that slows a task by 1 % where a row has a tenth of its length left.
const DAMPING: f64 = 0.01;

impl TaskPriority {
    /// For at most `tasks` tasks of a robot with `joints` joints; the only place where memory is taken.
    pub fn new(joints: usize, tasks: usize) -> Self {
        let level = Level {
            rows: Rows::zeros(joints),
            factor: None,
        };
        Self {
            damping: DAMPING,
            factor: DMatrix::zeros(joints, joints),
            levels: vec![level; tasks],
            used: 0,
            z: DVector::zeros(joints),
            row: DVector::zeros(joints),
        }
    }

    /// Begins anew with the reduced inertia `Ĥ` of the present position.
    pub fn begin(&mut self, inertia: &DMatrix<f64>) {
        let n = inertia.nrows();
        for j in 0..n {
            for i in j..n {
                let known: f64 = (0..j)
                    .map(|k| self.factor[(i, k)] * self.factor[(j, k)])
                    .sum();
                let left = inertia[(i, j)] - known;
                // Positive for every physical model.
                self.factor[(i, j)] = if i == j {
                    left.sqrt()
                } else {
                    left / self.factor[(j, j)]
                };
            }
        }
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
        let mut square = Matrix6::from_diagonal_element(self.damping * self.damping);
        for column in level.rows.column_iter() {
            square.ger(1.0, &column, &column, 1.0);
        }
        // Positive definite by its damping; what is not finite takes no part.
        level.factor = square.cholesky();
        if let Some(factor) = &level.factor {
            self.z.gemv_tr(1.0, &level.rows, &factor.solve(&off), 1.0);
        }
        self.used += 1;
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

    /// Writes the joint efforts `τ = L z` \[N m or N\] of all tasks.
    pub fn efforts(&self, out: &mut DVector<f64>) {
        for i in 0..out.len() {
            out[i] = (0..=i).map(|k| self.factor[(i, k)] * self.z[k]).sum();
        }
    }
}

impl Level {
    /// Takes off `y` what this task has use of.
    fn take_off(&self, y: &mut DVector<f64>) {
        if let Some(factor) = &self.factor {
            let along = factor.solve(&(&self.rows * &*y));
            y.gemv_tr(-1.0, &self.rows, &along, 1.0);
        }
    }
}

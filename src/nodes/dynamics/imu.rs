//! The inertial measurement unit at the origin of the base frame.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use super::{free_body::FreeBody as _, messages::header, world::World};
use crate::{
    msg::sensor_msgs,
    nodes::{geometry::vector_to_msg, placement::declare_vector},
    ros::{Declare, Time},
};

/// Measurement errors of the unit. All zero: an ideal unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImuParams {
    /// Standard deviation of each component of a measured angular velocity \[rad/s\].
    pub gyro_noise: f64,
    /// Standard deviation of each component of a measured acceleration \[m/s²\].
    pub accelerometer_noise: f64,
    /// Bias of each component of the measured angular velocity at the start \[rad/s\].
    pub gyro_bias: Vector3<f64>,
    /// Rate random walk of the bias \[rad/s^³⁄²\].
    pub gyro_bias_walk: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl ImuParams {
    /// Declares the parameters and reads them.
    pub fn declare(declare: &mut Declare) -> Self {
        let mut noise = |name: &str, text: &str| {
            let parameter = declare.param(name, 0.0, text).range(0.0, 10.0);
            parameter.read_only().value()
        };
        Self {
            gyro_noise: noise(
                "imu.gyro_noise",
                "Standard deviation of each component of the measured angular velocity [rad/s]",
            ),
            accelerometer_noise: noise(
                "imu.accelerometer_noise",
                "Standard deviation of each component of the measured acceleration [m/s2]",
            ),
            gyro_bias_walk: noise(
                "imu.gyro_bias_walk",
                "Rate random walk of the gyro's bias, which stands for its instability [rad/s^(3/2)]",
            ),
            gyro_bias: declare_vector(
                declare,
                "imu.gyro_bias",
                "Bias of the measured angular velocity at the start [rad/s]",
            ),
            seed: (declare.param("imu.seed", 1, "Seed of the measurement noise"))
                .read_only()
                .value()
                .unsigned_abs(),
        }
    }
}

impl ImuParams {
    /// Change of the gyro's bias in tick number `tick`, of duration `seconds` \[s\].
    pub(super) fn bias_step(&self, tick: u64, seconds: f64) -> Vector3<f64> {
        if self.gyro_bias_walk == 0.0 {
            return Vector3::zeros();
        }
        // Random numbers independent of those of the noise.
        let mut random = StdRng::seed_from_u64(!(self.seed.rotate_left(32) ^ tick));
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        Vector3::new(normal(), normal(), normal()) * (self.gyro_bias_walk * seconds.sqrt())
    }
}

/// The current measurement. The unit does not measure orientation. There is no gravity, so the accelerometer measures
/// the acceleration of the base frame's origin.
///
/// The noise depends only on the seed and the number of the state: publishing a state twice gives the same measurement.
pub fn imu(stamp: Time, base: &str, world: &mut World) -> sensor_msgs::Imu {
    let mut message = imu_message(base, world.imu());
    update_imu(&mut message, stamp, world);
    message
}

/// Template of an IMU message of the frame `base`, for [`update_imu`].
pub(super) fn imu_message(base: &str, params: &ImuParams) -> sensor_msgs::Imu {
    sensor_msgs::Imu {
        header: header(Time::ZERO, base),
        orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        angular_velocity_covariance: isotropic(params.gyro_noise),
        linear_acceleration_covariance: isotropic(params.accelerometer_noise),
        ..sensor_msgs::Imu::default()
    }
}

/// Updates a message of [`imu_message`].
pub(super) fn update_imu(message: &mut sensor_msgs::Imu, stamp: Time, world: &mut World) {
    let noise = world.imu().accelerometer_noise;
    let acceleration = world.base_acceleration().linear;
    let (angular_velocity, mut random) = measured_rate(world);
    let acceleration = with_noise(acceleration, noise, &mut random);
    message.header.stamp = stamp.into();
    message.angular_velocity = vector_to_msg(&angular_velocity);
    message.linear_acceleration = vector_to_msg(&acceleration);
}

/// The measured angular velocity alone \[rad/s\], base axes; cheaper than [`imu`], as no accelerations are computed.
pub fn gyro(world: &World) -> Vector3<f64> {
    measured_rate(world).0
}

/// The measured angular velocity, and the noise generator for the rest of the measurement.
fn measured_rate(world: &World) -> (Vector3<f64>, NoiseGenerator) {
    let params = world.imu();
    let biased = world.robot.V_WB_B().angular + world.gyro_bias();
    let mut random = NoiseGenerator::new(params.seed.rotate_left(32) ^ world.ticks());
    let measured = match params.gyro_noise == 0.0 {
        true => {
            // Skips the gyro's numbers: the accelerometer's noise is the same with and without gyro noise.
            random.skip += 3;
            biased
        }
        false => with_noise(biased, params.gyro_noise, &mut random),
    };
    (measured, random)
}

/// A measured vector whose components have the standard deviation `noise`.
fn with_noise(truth: Vector3<f64>, noise: f64, random: &mut NoiseGenerator) -> Vector3<f64> {
    match noise == 0.0 {
        true => truth,
        false => truth + random.normal() * noise,
    }
}

/// Normally distributed numbers that depend only on the seed. The generator is created with the first number, since an
/// ideal unit needs none.
struct NoiseGenerator {
    seed: u64,
    /// Created with the first number.
    random: Option<StdRng>,
    /// Numbers to skip before the next one.
    skip: u32,
}

impl NoiseGenerator {
    fn new(seed: u64) -> Self {
        Self {
            seed,
            random: None,
            skip: 0,
        }
    }

    fn normal(&mut self) -> Vector3<f64> {
        let seed = self.seed;
        let random = (self.random).get_or_insert_with(|| StdRng::seed_from_u64(seed));
        for _ in 0..std::mem::take(&mut self.skip) {
            random.sample::<f64, _>(StandardNormal);
        }
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        Vector3::new(normal(), normal(), normal())
    }
}

/// Covariance of three independent components with this standard deviation, by rows.
fn isotropic(deviation: f64) -> [f64; 9] {
    let v = deviation * deviation;
    [v, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, v]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::scenario::Scenario;

    fn world(imu: ImuParams) -> World {
        let scenario = Scenario::read("package://fuyu/config/positioning.yaml").unwrap();
        let mut params = scenario.dynamics().unwrap();
        params.imu = imu;
        let mut world = World::new(&params).unwrap();
        world
            .robot
            .hold_efforts(&[50.0, -10.0, 20.0, 1.0, 0.5, -0.5]);
        world
    }

    // Wrong axes, a wrong point, or the acceleration of another state would show as a difference from
    // the velocity's change in the world.
    #[test]
    fn an_ideal_unit_measures_how_the_base_moves() {
        let mut world = world(ImuParams::default());
        let velocity = |world: &World| world.robot.state().R_WB * world.robot.V_WB_B().linear;
        for _ in 0..100 {
            world.step_to_tick();
        }
        let measured = imu(Time::ZERO, "base_link", &mut world);
        let w = world.robot.V_WB_B().angular;
        assert!(w.norm() > 1e-3, "{w}");
        assert_eq!(measured.angular_velocity, vector_to_msg(&w));
        let (before, R_WB) = (velocity(&world), world.robot.state().R_WB);
        let dt = 1e-5;
        world.robot.step(dt, 1);
        let a = R_WB.inverse() * ((velocity(&world) - before) / dt);
        let read = &measured.linear_acceleration;
        let read = Vector3::new(read.x, read.y, read.z);
        // The acceleration changes by some 1e-5 of itself within dt.
        assert!((read - a).norm() < 1e-4 * a.norm(), "{read} against {a}");
    }

    #[test]
    fn noise_has_the_stated_size_and_repeats_with_the_state() {
        let mut world = world(ImuParams {
            gyro_noise: 1e-3,
            accelerometer_noise: 0.1,
            seed: 7,
            ..ImuParams::default()
        });
        let mut squares = [0.0; 2];
        let states = 2000;
        for _ in 0..states {
            world.step_to_tick();
            let truth = world.robot.V_WB_B().angular;
            let measured = imu(Time::ZERO, "base_link", &mut world);
            assert_eq!(measured, imu(Time::ZERO, "base_link", &mut world));
            let w = &measured.angular_velocity;
            squares[0] += (Vector3::new(w.x, w.y, w.z) - truth).norm_squared();
            let a = world.robot.A_WB_B().linear;
            let read = &measured.linear_acceleration;
            squares[1] += (Vector3::new(read.x, read.y, read.z) - a).norm_squared();
        }
        // 6000 draws know their standard deviation to 1 %.
        for (sum, noise) in squares.iter().zip([1e-3, 0.1]) {
            let deviation = (sum / (3.0 * f64::from(states))).sqrt();
            assert!(
                (deviation / noise - 1.0).abs() < 0.05,
                "{deviation} for {noise}"
            );
        }
    }

    // A bias is constant without a walk; with one it wanders by its density times the square root of time, and repeats.
    #[test]
    fn the_bias_of_the_gyro_wanders() {
        let start = Vector3::new(4e-4, -3e-4, 2e-4);
        let walk = |gyro_bias_walk: f64| {
            let mut world = world(ImuParams {
                gyro_bias: start,
                gyro_bias_walk,
                seed: 7,
                ..ImuParams::default()
            });
            for _ in 0..400 {
                world.step_to_tick();
            }
            world.gyro_bias() - start
        };
        assert_eq!(walk(0.0), Vector3::zeros());
        let moved = walk(1e-6);
        assert_eq!(moved, walk(1e-6));
        // 4 s; three components within three standard deviations.
        assert!(moved.norm() > 0.0 && moved.amax() < 6e-6, "{moved}");
    }
}

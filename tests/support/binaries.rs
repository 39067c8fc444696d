//! The executables under test.

/// Path of an executable of fuyu.
pub fn binary(name: &str) -> &'static str {
    match name {
        "fuyu" => env!("CARGO_BIN_EXE_fuyu"),
        "dynamics" => env!("CARGO_BIN_EXE_dynamics"),
        "camera" => env!("CARGO_BIN_EXE_camera"),
        "controller" => env!("CARGO_BIN_EXE_controller"),
        "mission" => env!("CARGO_BIN_EXE_mission"),
        "estimator" => env!("CARGO_BIN_EXE_estimator"),
        "tracker" => env!("CARGO_BIN_EXE_tracker"),
        "teleop" => env!("CARGO_BIN_EXE_teleop"),
        "attitude" => env!("CARGO_BIN_EXE_attitude"),
        "recorder" => env!("CARGO_BIN_EXE_recorder"),
        other => panic!("{other} is no executable of fuyu"),
    }
}

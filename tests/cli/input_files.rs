//! Files that commands read: devices, pipes, other packages, and those in the executable.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

fn fuyu(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fuyu"));
    command.args(args);
    command
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn devices_and_pipes_are_refused_by_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    for file in ["/dev/zero", pipe.to_str().unwrap()] {
        for command in [
            &["estimate"][..],
            &["inspect"],
            &["simulate"],
            &["launch"],
            &["bag", "info"],
            &["bag", "check"],
        ] {
            let start = Instant::now();
            // Little memory, so that reading without end fails instead of filling the computer's.
            let mut limited = Command::new("sh");
            limited.args([
                "-c",
                "ulimit -v 4000000; exec \"$@\"",
                "sh",
                env!("CARGO_BIN_EXE_fuyu"),
            ]);
            let output = limited.args(command).arg(file).output().unwrap();
            let errors = errors(&output);
            assert_eq!(
                output.status.code(),
                Some(2),
                "{command:?} {file}: {errors}"
            );
            assert!(
                errors.contains(file) && errors.contains("regular file"),
                "{command:?}: {errors}"
            );
            assert!(start.elapsed() < Duration::from_secs(20));
        }
    }
}

#[test]
fn a_file_larger_than_the_limit_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.csv");
    let file = fs::File::create(&path).unwrap();
    file.set_len(3 << 30).unwrap();
    for (command, limit) in [
        ("estimate", "256 MiB"),
        ("inspect", "16 MiB"),
        ("simulate", "16 MiB"),
    ] {
        let output = fuyu(&[command]).arg(&path).output().unwrap();
        let errors = errors(&output);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(limit), "{errors}");
    }
}

#[test]
fn other_packages_are_found_in_the_ros_environment() {
    let dir = tempfile::tempdir().unwrap();
    let share = dir.path().join("share/acme_robots/urdf");
    fs::create_dir_all(&share).unwrap();
    let urdf = concat!(env!("CARGO_MANIFEST_DIR"), "/urdf/target.urdf");
    fs::copy(urdf, share.join("rock.urdf")).unwrap();
    let name = "package://acme_robots/urdf/rock.urdf";
    let inspect = |prefix: &str| {
        let prefixes = format!("/no/such:{prefix}");
        fuyu(&["inspect", name])
            .env("AMENT_PREFIX_PATH", prefixes)
            .output()
            .unwrap()
    };
    let output = inspect(dir.path().to_str().unwrap());
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("total mass"));
    let output = inspect("/nowhere");
    assert_eq!(output.status.code(), Some(2));
    assert!(
        errors(&output).contains("/nowhere/share/acme_robots"),
        "{}",
        errors(&output)
    );
    let output = fuyu(&["inspect", "package://fuyu/../../etc/passwd"])
        .output()
        .unwrap();
    assert!(
        errors(&output).contains("without '..'"),
        "{}",
        errors(&output)
    );
}

#[test]
fn a_copied_executable_has_its_scenarios() {
    let dir = tempfile::tempdir().unwrap();
    let copy = dir.path().join("fuyu");
    fs::copy(env!("CARGO_BIN_EXE_fuyu"), &copy).unwrap();
    // The sources are hidden in a mount namespace.
    let script = "for folder in config launch urdf views; do \
                  mount -t tmpfs none \"$1/$folder\" || exit 77; done; shift; exec \"$@\"";
    for args in [
        &[
            "simulate",
            "package://fuyu/config/servicing.yaml",
            "--duration",
            "0.1",
        ][..],
        &["simulate", "config/straight_path.yaml", "--duration", "0.1"],
        &["inspect", "package://fuyu/urdf/servicer.urdf"],
    ] {
        let mut command = Command::new("unshare");
        command.args([
            "--mount",
            "sh",
            "-c",
            script,
            "sh",
            env!("CARGO_MANIFEST_DIR"),
        ]);
        command
            .arg(&copy)
            .args(args)
            .current_dir(dir.path())
            .env_remove("AMENT_PREFIX_PATH");
        match command.output() {
            Ok(output) if output.status.code() == Some(0) => {}
            Ok(output) if errors(&output).contains("fuyu: ") => {
                panic!("{args:?}: {}", errors(&output))
            }
            _ => return println!("SKIPPED: no mount namespace can be created here"),
        }
    }
}

#[test]
fn the_files_that_come_with_fuyu_can_be_written_to_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let write = || {
        fuyu(&["files", "--output"])
            .arg(dir.path())
            .output()
            .unwrap()
    };
    assert_eq!(write().status.code(), Some(0));
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for path in [
        "config/servicing.yaml",
        "urdf/servicer.urdf",
        "views/fuyu.rviz",
        "launch/servicing.launch.xml",
    ] {
        assert_eq!(
            fs::read(dir.path().join(path)).unwrap(),
            fs::read(root.join(path)).unwrap()
        );
    }
    // Again without a change, and never over a file of the user's.
    assert_eq!(write().status.code(), Some(0));
    let edited = dir.path().join("config/servicing.yaml");
    fs::write(&edited, "mine").unwrap();
    let output = write();
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("exists with other content"));
    assert_eq!(fs::read(&edited).unwrap(), b"mine");
}

#[test]
fn nodes_have_help_and_a_version() {
    for node in [
        env!("CARGO_BIN_EXE_dynamics"),
        env!("CARGO_BIN_EXE_camera"),
        env!("CARGO_BIN_EXE_recorder"),
    ] {
        let run = |arg: &str| {
            let output = Command::new(node).arg(arg).output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
            String::from_utf8(output.stdout).unwrap()
        };
        let name = Path::new(node).file_name().unwrap().to_str().unwrap();
        assert!(run("--help").contains(&format!("Usage: {name} [--ros-args")));
        assert_eq!(
            run("--version"),
            format!("{name} {}\n", env!("CARGO_PKG_VERSION"))
        );
    }
}

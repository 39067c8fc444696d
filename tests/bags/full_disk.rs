//! Recording to a disk that becomes full: a small tmpfs in a mount namespace.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use fuyu::bag::{
    Bag, Compression, Recorder, RecorderHandle, RecorderStatus, Topic, Writer, WriterOptions,
};
use fuyu::ros::Qos;

/// Folder of the small disk, for the child processes of these tests.
const DISK: &str = "FUYU_TEST_SMALL_DISK";

/// Runs the ignored test `name` of this program with a file system of one megabyte at `DISK`; `false` if it cannot be
/// mounted.
fn on_a_small_disk(name: &str) -> bool {
    let dir = tempfile::tempdir().unwrap();
    let mut command = Command::new("unshare");
    let script = "mount -t tmpfs -o size=1m none \"$1\" || exit 77; shift; exec \"$@\"";
    command.args(["--mount", "sh", "-c", script, "sh"]);
    command
        .arg(dir.path())
        .arg(std::env::current_exe().unwrap());
    command.args(["--ignored", "--exact", name, "--nocapture"]);
    let output = command.env(DISK, dir.path()).output();
    let output = output
        .ok()
        .filter(|o| o.status.code() == Some(0) || o.stdout.starts_with(b"\nrunning"));
    let Some(output) = output else {
        let is_root = fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
        assert!(
            std::env::var_os("CI").is_none() || !is_root,
            "no mount namespace in CI"
        );
        println!("SKIPPED: no file system can be mounted here");
        return false;
    };
    let log = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && log.contains("1 passed"), "{log}");
    true
}

fn start(disk: &Path) -> (PathBuf, Recorder, impl Fn(u64) -> bool + use<>) {
    let path = disk.join("bag");
    let options = WriterOptions {
        compression: Compression::None,
        chunk_size: 20_000,
        ..WriterOptions::default()
    };
    let recorder = Recorder::start(Writer::create(&path, options).unwrap()).unwrap();
    let handle = recorder.handle();
    let topic = handle
        .add_topic(Topic::named("/data", "std_msgs/msg/String", Qos::RELIABLE))
        .unwrap();
    let write = move |i: u64| handle.write(&topic, i, i, vec![i as u8; 1000]);
    (path, recorder, write)
}

fn wait_for(handle: &RecorderHandle, what: &str, is: impl Fn(&RecorderStatus) -> bool) {
    let start = Instant::now();
    while !is(&handle.status()) {
        assert!(
            start.elapsed() < Duration::from_secs(20),
            "{what}: {:?}",
            handle.status()
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn recording_continues_without_loss_when_there_is_space_again() {
    on_a_small_disk("full_disk::child_space_returns");
}

#[test]
#[ignore = "started by recording_continues_without_loss_when_there_is_space_again"]
fn child_space_returns() {
    let Some(disk) = std::env::var_os(DISK).map(PathBuf::from) else {
        return;
    };
    let filler = disk.join("filler");
    fs::write(&filler, vec![1; 800_000]).unwrap();
    let (path, recorder, write) = start(&disk);
    let handle = recorder.handle();
    for i in 0..500 {
        assert!(write(i));
    }
    wait_for(&handle, "the disk is full", |s| s.waiting.is_some());
    let status = handle.status();
    assert!(status.waiting.unwrap().contains("No space left on device"));
    assert_eq!(status.failure, None);
    // Neither a split nor a flush blocks its caller.
    let error = handle.split().unwrap_err().to_string();
    assert!(error.contains("No space left on device"), "{error}");
    fs::remove_file(&filler).unwrap();
    for i in 500..600 {
        assert!(write(i));
    }
    wait_for(&handle, "all is written", |s| s.written == 600);
    assert_eq!(handle.status().waiting, None);
    let recording = recorder.finish().unwrap();
    assert_eq!((recording.messages, recording.dropped), (600, 0));
    let mut messages = Bag::open(path).unwrap().messages();
    assert!(messages.by_ref().map(|m| m.log_time).eq(0..600));
    assert_eq!(messages.damage(), []);
}

#[test]
fn a_recording_that_ends_on_a_full_disk_says_so_and_can_be_read() {
    on_a_small_disk("full_disk::child_ends");
}

#[test]
#[ignore = "started by a_recording_that_ends_on_a_full_disk_says_so_and_can_be_read"]
fn child_ends() {
    let Some(disk) = std::env::var_os(DISK).map(PathBuf::from) else {
        return;
    };
    let (path, recorder, write) = start(&disk);
    for i in 0..2000 {
        assert!(write(i));
    }
    wait_for(&recorder.handle(), "the disk is full", |s| {
        s.waiting.is_some()
    });
    let begin = Instant::now();
    let error = recorder.finish().unwrap_err().to_string();
    assert!(begin.elapsed() < Duration::from_secs(10));
    assert!(
        error.contains("bag_0.mcap: No space left on device"),
        "{error}"
    );
    let mut messages = Bag::open(path).unwrap().messages();
    let read: Vec<u64> = messages.by_ref().map(|m| m.log_time).collect();
    assert!(read.len() > 800 && read.iter().copied().eq(0..read.len() as u64));
    assert!(!messages.damage().is_empty());
}

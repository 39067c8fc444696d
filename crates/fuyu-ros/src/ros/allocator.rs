//! Return of freed memory from the allocator to the operating system.

use std::{thread, time::Duration};

use super::signals;

/// Blocks of at least this size are returned to the operating system as soon as they are freed \[bytes\]. The value is
/// glibc's initial one, which glibc would raise whenever a larger block is freed.
#[cfg(target_env = "gnu")]
const LARGE: i32 = 128 << 10;
/// Period at which unused pages are returned.
const PERIOD: Duration = Duration::from_secs(60);

/// Makes freed memory return to the operating system: large blocks at once, others within a minute. The main function
/// of a long-running process calls this before it starts other threads. No effect with C libraries other than glibc.
///
/// A recorder frees a zstd context of some megabytes whenever it begins another file. By default glibc then keeps such
/// blocks between small ones, and memory fragments: the recorder took 21 MB instead of 14.5, and half a megabyte more with
/// each file, up to some ten files. Backlogs of messages on a busy computer also leave holes in the memory of every
/// thread that handles them: at 1 kHz the memory of a subscriber grew by 3 % in an hour.
pub fn return_free_memory() {
    if !cfg!(target_env = "gnu") {
        return;
    }
    return_large_blocks();
    let returner = || {
        thread::Builder::new().name("memory".to_owned()).spawn(|| {
            loop {
                thread::sleep(PERIOD);
                return_free_pages();
            }
        })
    };
    if let Err(e) = signals::with_blocked(returner) {
        tracing::warn!("free memory stays with the process: {e}");
    }
}

fn return_large_blocks() {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt takes two numbers and only changes how later blocks are allocated; glibc holds its lock meanwhile.
    unsafe {
        nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, LARGE);
    }
}

fn return_free_pages() {
    #[cfg(target_env = "gnu")]
    // SAFETY: malloc_trim takes a number and touches only unallocated memory; glibc locks every arena meanwhile.
    unsafe {
        nix::libc::malloc_trim(0);
    }
}

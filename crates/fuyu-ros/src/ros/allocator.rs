//! Return of freed memory from the allocator to the operating system.

use std::{thread, time::Duration};

use super::signals;

/// From this size on, a block is the operating system's again as soon as it is freed \[bytes\]. glibc begins with as much,
/// but raises it with every larger block that is freed.
#[cfg(target_env = "gnu")]
const LARGE: i32 = 128 << 10;
/// How often pages without anything in them are given back.
const PERIOD: Duration = Duration::from_secs(60);

/// Makes freed memory return to the operating system, large blocks at once, others within a minute. For the main function
/// of a process that runs for long, before it has other threads; other C libraries than glibc are left as they are.
///
/// A recorder frees a context of zstd, some megabytes, whenever it begins another file. Left to itself, glibc then keeps
/// such blocks among the small ones, where they fragment: it took 21 MB instead of 14.5, and half a megabyte more with each
/// file, up to some ten files. And what waits while others have the processors leaves holes in the memory of
/// every thread that it went through: in an hour at 1 kHz on a busy computer, 3 % of a subscriber.
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
    // SAFETY: it takes two numbers and changes nothing but where later blocks come from; glibc locks around it.
    unsafe {
        nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, LARGE);
    }
}

fn return_free_pages() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it takes a number and touches only what is not allocated; glibc locks every arena around it.
    unsafe {
        nix::libc::malloc_trim(0);
    }
}

//! What the allocator does with large blocks.

/// From this size on, a block is the operating system's again as soon as it is freed \[bytes\]. glibc begins with as much,
/// but raises it with every larger block that is freed.
const LARGE: i32 = 128 << 10;

/// Makes freed large blocks return to the operating system. For the main function of a process that runs for long, before
/// it has other threads; other C libraries than glibc are left as they are.
///
/// A recorder frees a context of zstd, some megabytes, whenever it begins another file. Left to itself, glibc then keeps
/// such blocks among the small ones, where they fragment: it took 21 MB instead of 14.5, and half a megabyte more with each
/// file, up to some ten files.
pub fn return_large_blocks() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it takes two numbers and changes nothing but where later blocks come from; glibc locks around it.
    unsafe {
        nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, LARGE);
    }
}

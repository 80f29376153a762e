//! The memory that a process keeps for its next frames.
//!
//! The allocator of glibc gives freed memory back to the system as soon as more than twice the size of the largest image is free. A node
//! frees more with each frame: the pages would be unmapped, and mapped and cleared again for the next frame.

/// The most freed memory that each arena of the allocator keeps, in bytes: that of several images of 1920 x 1080 px as floats.
#[cfg(target_env = "gnu")]
const KEPT: i32 = 128 << 20;
/// The size in bytes from which a block is mapped by itself, and unmapped when it is freed. The images that nodes exchange are smaller:
/// one of 1920 x 1080 px with 8 bits has 6.2 MB.
#[cfg(target_env = "gnu")]
const MAPPED: i32 = 8 << 20;

/// The most arenas, each of which keeps freed memory of its own: images are freed by many threads, but by few at once.
#[cfg(target_env = "gnu")]
const ARENAS: i32 = 2;

/// Lets the process keep memory that it frees. Allocators other than that of glibc are left as they are.
pub fn keep_freed_memory() {
    #[cfg(target_env = "gnu")]
    for (parameter, value) in
        [(libc::M_TRIM_THRESHOLD, KEPT), (libc::M_MMAP_THRESHOLD, MAPPED), (libc::M_ARENA_MAX, ARENAS)]
    {
        // The thresholds only save time, so that a refusal is not reported.
        #[expect(unsafe_code, reason = "a function of the C library")]
        // SAFETY: `mallopt` takes its own locks, and any value of these parameters is sound.
        unsafe {
            libc::mallopt(parameter, value);
        }
    }
}

#[cfg(all(test, target_env = "gnu"))]
mod tests {
    use super::*;

    /// Returns the pages that were mapped for this thread so far.
    fn faults() -> u64 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("Linux has this file");
        // The name of the thread, which may hold spaces, ends at the last bracket; the eighth field after it has the count.
        let fields = stat.rsplit_once(") ").expect("a name in brackets").1;
        fields.split(' ').nth(7).expect("a count").parse().expect("a number")
    }

    #[test]
    fn images_of_the_next_frame_get_the_memory_of_the_last_one() {
        keep_freed_memory();
        let frame = || {
            let images: Vec<Vec<u8>> = (0..6).map(|n| vec![n + 1; 5 << 20]).collect();
            std::hint::black_box(images);
        };
        frame();
        let before = faults();
        (0..10).for_each(|_| frame());
        let mapped = faults() - before;
        // Without this, each frame maps 7,680 pages of 4 KiB.
        assert!(mapped < 7680, "{mapped} pages in 10 frames");
    }
}

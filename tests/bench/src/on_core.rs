//! Program for the core: drives every candidate over the same ticks and leaves its state in `RESULTS`.
//! `cargo xtask bench` counts the instructions of each `step`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("on-core runs on the robot's core: `cargo xtask bench` builds and runs it");
    std::process::exit(2);
}

#[cfg(target_os = "none")]
mod core_program {
    use core::sync::atomic::{AtomicU32, Ordering};
    use odometry_bench::{CANDIDATES, Candidate, Course, TICKS_ON_CORE, drive, for_each_candidate};

    /// Six words for each candidate, the lower one of each number first, and then 1.
    #[used]
    static RESULTS: [AtomicU32; 6 * CANDIDATES + 1] =
        [const { AtomicU32::new(0) }; 6 * CANDIDATES + 1];

    fn store(at: usize, value: u32) {
        if let Some(word) = RESULTS.get(at) {
            word.store(value, Ordering::Relaxed);
        }
    }

    fn run<C: Candidate>(number: usize, _name: &str) {
        let candidate = drive::<C>(Course::curves().take(TICKS_ON_CORE));
        for (at, value) in candidate.bits().into_iter().enumerate() {
            store(6 * number + 2 * at, value as u32);
            store(6 * number + 2 * at + 1, (value >> 32) as u32);
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        for_each_candidate!(run);
        store(6 * CANDIDATES, 1);
        loop {
            core::hint::spin_loop();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        loop {
            core::hint::spin_loop();
        }
    }
}

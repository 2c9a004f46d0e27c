//! The program for the core: every way over the same ticks, one after the other. Whoever runs it
//! counts the instructions of each `step`, and reads what they came to out of [`RESULTS`].
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("on-core runs on the robot's core: `cargo xtask bench` builds and runs it");
    std::process::exit(2);
}

#[cfg(target_os = "none")]
mod core_program {
    use core::sync::atomic::{AtomicU32, Ordering};
    use fw_core::eeprom::Platform;
    use odometry_bench::{every_way, Course, Way, ON_CORE, WAYS};

    /// Six words for each way, the lower one of each number first, and then 1.
    #[used]
    static RESULTS: [AtomicU32; 6 * WAYS + 1] = [const { AtomicU32::new(0) }; 6 * WAYS + 1];

    fn store(at: usize, value: u32) {
        if let Some(word) = RESULTS.get(at) {
            word.store(value, Ordering::Relaxed);
        }
    }

    fn run<W: Way>(number: usize, _name: &str) {
        let platform = Platform::FIRST_BOARD;
        let mut way = W::new(&platform);
        let (mut left, mut right) = (0_u32, 0_u16);
        for tick in Course::curves().take(ON_CORE) {
            // The first board's encoders count down going ahead.
            left = left.wrapping_sub(tick.left as u32);
            right = right.wrapping_sub(tick.right as u16);
            way.tick(left, right);
        }
        for (at, value) in way.bits().into_iter().enumerate() {
            store(6 * number + 2 * at, value as u32);
            store(6 * number + 2 * at + 1, (value >> 32) as u32);
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        every_way!(run);
        store(6 * WAYS, 1);
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

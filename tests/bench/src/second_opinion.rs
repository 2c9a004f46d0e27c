//! Program for the host and for QEMU's Cortex-M4: what [`exercise`] comes to in every mode, and the odometry
//! of a course. Both must print the same.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
use cortex_m_semihosting::hprintln as println;
use fw_core::wire::Mode;
use odometry_bench::{Candidate, Course, FwCore, TICKS_ON_CORE, drive, exercise};

fn report() {
    for mode in Mode::ALL {
        let (digest, pose) = exercise(*mode);
        println!("{}: {:016x}, pose {:?}", mode.name(), digest, pose);
    }
    let odometry = drive::<FwCore>(Course::curves().take(TICKS_ON_CORE));
    println!("odometry: {:x?}", odometry.bits());
}

#[cfg(not(target_os = "none"))]
fn main() {
    report();
}

#[cfg(target_os = "none")]
mod core_program {
    use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, exit};

    #[cortex_m_rt::entry]
    fn main() -> ! {
        super::report();
        exit(EXIT_SUCCESS);
        loop {
            core::hint::spin_loop();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        exit(EXIT_FAILURE);
        loop {
            core::hint::spin_loop();
        }
    }
}

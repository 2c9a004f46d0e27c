//! Failures on purpose, two seconds after READY, one for each `test-…` feature: to see on the real
//! program that every one of them ends with the motors off. The released firmware has none.

/// Counts ticks and fails at the two-hundredth.
#[cfg(any(
    feature = "test-panic",
    feature = "test-overflow",
    feature = "test-hang",
    feature = "test-interrupt"
))]
pub fn tick() {
    use core::sync::atomic::{AtomicU32, Ordering};
    static TICKS: AtomicU32 = AtomicU32::new(0);
    if TICKS.fetch_add(1, Ordering::Relaxed) < 200 {
        return;
    }
    #[cfg(feature = "test-panic")]
    panic!("on purpose");
    #[cfg(feature = "test-overflow")]
    crate::stack_overflow::descend(0);
    #[cfg(feature = "test-hang")]
    loop {
        cortex_m::asm::nop();
    }
    #[cfg(feature = "test-interrupt")]
    {
        use cortex_m::peripheral::NVIC;
        use stm32f4::stm32f411::Interrupt;
        // SAFETY: unhandled on purpose.
        unsafe { NVIC::unmask(Interrupt::RTC_ALARM) };
        NVIC::pend(Interrupt::RTC_ALARM);
    }
}

/// Nothing fails on purpose.
#[cfg(not(any(
    feature = "test-panic",
    feature = "test-overflow",
    feature = "test-hang",
    feature = "test-interrupt"
)))]
pub const fn tick() {}

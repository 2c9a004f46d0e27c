//! The interrupt handlers and their priorities.
//!
//! | priority | handler | does |
//! |---|---|---|
//! | −2, −1 | NMI, HardFault, and any unexpected interrupt | [`crate::safe_state`], for good |
//! | 0 | TIM5, EXTI0, EXTI9_5, EXTI15_10 | latch the tick, time the echoes |
//! | 0 | `SysTick` | [`crate::safe_state`]: no tick for 30 ms |
//! | 1 | EXTI4 | end of a frame: swaps the SPI's buffers |
//! | 2 | PendSV, DMA2_STREAM7, I2C1_EV, I2C1_ER, DMA1_STREAM0 | the robot: frames, echoes, ticks, log, gyroscope |
//! | thread | `main` | feeds the watchdog, sleeps |

use crate::app::APP;
use crate::gyro::Gyro;
use crate::priority::{Capture, FrameEnd, RobotLevel};
use crate::{exti, rangefinders, spi, tick, time, watchdog};
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{NVIC, Peripherals, SCB};
use cortex_m_rt::exception;
use fw_core::types::RangefinderId;
use stm32f4::stm32f411::{Interrupt, interrupt};

/// Defines the handlers, each with the token of its priority, and `enable_all`, which sets exactly
/// these priorities.
macro_rules! handlers {
    ($($name:ident: $priority:ident => $body:expr;)*) => {
        $(
            #[interrupt]
            fn $name() {
                // SAFETY: `enable_all` gives this handler this priority.
                let mut token = unsafe { $priority::new() };
                let body: fn(&mut $priority) = $body;
                body(&mut token);
                end();
            }
        )*

        /// One store after the other and no loop for the priorities: `cargo xtask stack` reads them.
        fn enable_all(nvic: &mut NVIC) {
            const MASKS: [u32; 3] = {
                let mut masks = [0; 3];
                $(masks[Interrupt::$name as usize / 32] |= 1 << (Interrupt::$name as usize % 32);)*
                masks
            };
            // SAFETY: interrupts are masked, and the tokens' owners are in place.
            unsafe {
                $(nvic.set_priority(Interrupt::$name, $priority::NVIC);)*
                for (word, mask) in MASKS.into_iter().enumerate() {
                    // Boot's polling leaves some of them pending.
                    nvic.icpr[word].write(mask);
                    nvic.iser[word].write(mask);
                }
            }
        }
    };
}

// Requirement: DOC-3.1-1
handlers! {
    EXTI4: FrameEnd => |token| {
        let at = time::now();
        exti::clear(exti::FRAME);
        spi::end_frame(at, token);
        SCB::set_pendsv();
    };
    TIM5: Capture => |token| tick::on_timer(&token.critical_section());
    EXTI0: Capture => |token| on_edge(token, RangefinderId::Right, exti::ECHO_RIGHT);
    EXTI9_5: Capture => |token| on_edge(token, RangefinderId::Front, exti::ECHO_FRONT);
    EXTI15_10: Capture => |token| on_edge(token, RangefinderId::Left, exti::ECHO_LEFT);
    DMA2_STREAM7: RobotLevel => |token| APP.borrow(token).service_log();
    I2C1_EV: RobotLevel => |token| APP.borrow(token).on_gyro(Gyro::on_event);
    I2C1_ER: RobotLevel => |token| APP.borrow(token).on_gyro(Gyro::on_error);
    DMA1_STREAM0: RobotLevel => |token| APP.borrow(token).on_gyro(Gyro::on_received);
}

/// A store that is still on its way at an exception's return may lead to another's vector (Cortex-M4 r0p1, erratum
/// 838869; ES0287, 2.1).
#[inline]
fn end() {
    cortex_m::asm::dsb();
}

#[inline]
fn on_edge(token: &mut Capture, which: RangefinderId, line: u8) {
    let at = time::now();
    exti::clear(line);
    rangefinders::on_edge(which, at, &token.critical_section());
}

// Requirement: DOC-2.1-6
#[exception]
fn PendSV() {
    // SAFETY: `enable` gives this handler this priority.
    let mut token = unsafe { RobotLevel::new() };
    APP.borrow(&mut token).process_events();
    end();
}

/// Enables every interrupt. Takes the token with which boot used what is the handlers' from here on.
pub fn enable(_: RobotLevel) {
    // SAFETY: interrupts are masked; no one else uses the core's peripherals.
    let mut core = unsafe { Peripherals::steal() };
    exti::start();
    // SAFETY: as `enable_all`.
    unsafe {
        core.SCB
            .set_priority(SystemHandler::PendSV, RobotLevel::NVIC);
        core.SCB.set_priority(SystemHandler::SysTick, Capture::NVIC);
    }
    enable_all(&mut core.NVIC);
    tick::start();
    watchdog::await_ticks(&mut core.SYST);
    // SAFETY: what every handler uses is in place.
    unsafe { cortex_m::interrupt::enable() };
}

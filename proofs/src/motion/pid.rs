//! T7: the regulator's output and integral stay within its limit, whatever the factors.

use fixed::types::I16F16;
use fw_core::double::Double;
#[cfg(kani)]
use fw_core::eeprom::first_board;
use fw_core::eeprom::Gains;
use fw_core::motion::pid::Pid;

use crate::input::{Input, Source};
use crate::theorem::Seen;

/// A regulator in a state that it can reach: any integral within its limit.
fn regulator(gains: &Gains, limit: i32, integral: i32) -> Pid {
    let mut pid = Pid::new(gains, I16F16::from_bits(limit));
    pid.start_at(I16F16::from_bits(integral), I16F16::ZERO, I16F16::ZERO);
    pid
}

/// The limit as the regulator takes it: 0 to 100 %.
fn cut(limit: i32) -> i32 {
    limit.clamp(0, 100 << 16)
}

/// The inductive step: from any integral within the limit, any error and any rate, output and integral
/// are within the limit again. Nothing overflows, for any factors.
pub fn step_stays_within_the_limit(
    gains: Gains,
    limit: i32,
    integral: i32,
    error: i32,
    rate: i32,
) -> Seen {
    let mut pid = regulator(&gains, limit, integral);
    let cut = cut(limit);
    assert!(pid.integral().to_bits().abs() <= cut);
    let output = pid
        .step(I16F16::from_bits(error), I16F16::from_bits(rate))
        .to_bits();
    assert!(output.abs() <= cut);
    assert!(pid.integral().to_bits().abs() <= cut);
    Seen::NOTHING
        .case(0, output == cut && cut > 0)
        .case(1, output == -cut && cut > 0)
        .case(2, output.abs() < cut && output != 0)
}

/// Changing the limit cuts the integral to it.
pub fn limit_change_cuts_the_integral(
    gains: Gains,
    before: i32,
    integral: i32,
    after: i32,
) -> Seen {
    let mut pid = regulator(&gains, before, integral);
    pid.set_limit(I16F16::from_bits(after));
    let kept = pid.integral().to_bits();
    assert!(kept.abs() <= cut(after));
    pid.reset();
    assert!(pid.integral() == 0);
    Seen::NOTHING
        .case(0, kept == cut(after) && kept > 0)
        .case(1, kept.abs() < cut(after) && kept != 0)
}

/// Saturation ends with the first sample whose error points back, when the proportional part is
/// at least a thousandth of a percent and the measurement stands: the integral never holds the
/// output at its limit.
pub fn saturation_ends_at_once(gains: Gains, limit: i32, integral: i32, error: i32) -> Seen {
    let back = Double(gains.p.0)
        .to_scaled(16)
        .is_ok_and(|p| i128::from(p) * i128::from(error) > 1 << 23);
    let factors = [gains.p, gains.i, gains.anti_windup];
    let accepted = factors.iter().all(|factor| {
        factor
            .to_scaled(32)
            .is_ok_and(|f| (0..=10_000 << 32).contains(&f))
    });
    if error <= 0 || error == i32::MAX || !back || !accepted || cut(limit) <= 1 << 10 {
        return Seen::NOTHING;
    }
    let mut pid = regulator(&gains, limit, integral);
    let output = pid.step(I16F16::from_bits(-error), I16F16::ZERO).to_bits();
    assert!(output < cut(limit));
    Seen::NOTHING
        .case(0, integral >= cut(limit))
        .case(1, integral < 0)
}

/// Any sequence of errors and rates keeps the output within the limit.
pub fn sequence_stays_within_the_limit(
    gains: Gains,
    limit: i32,
    errors: [u8; 64],
    scale: u8,
) -> Seen {
    let mut pid = Pid::new(&gains, I16F16::from_bits(limit));
    let cut = cut(limit);
    let mut reached = false;
    for pair in errors.chunks_exact(2) {
        let large = |byte: u8| (i32::from(byte) - 128) << (scale % 24);
        let output = pid
            .step(
                I16F16::from_bits(large(pair[0])),
                I16F16::from_bits(large(pair[1])),
            )
            .to_bits();
        assert!(output.abs() <= cut && pid.integral().to_bits().abs() <= cut);
        reached |= output.abs() == cut;
    }
    Seen::NOTHING.case(0, reached).case(1, !reached)
}

impl Input for Gains {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            p: Input::draw(source),
            i: Input::draw(source),
            d: Input::draw(source),
            anti_windup: Input::draw(source),
        }
    }
}

/// Factors of every size with two bits of fraction: enough for every shift, small enough to
/// multiply.
#[cfg(kani)]
fn coarse_gains() -> Gains {
    let factor = || {
        let bits: u16 = crate::input::any();
        Double((bits as u64) << 50 & !(1 << 63))
    };
    Gains {
        p: factor(),
        i: factor(),
        d: factor(),
        anti_windup: factor(),
    }
}

crate::theorems! {
    T7 step_stays_within_the_limit(
        gains: Gains, limit: i32, integral: i32, error: i32, rate: i32
    ) {
        cases ["at the upper limit", "at the lower limit", "between"];
        kani first_board_forward [unwind(4)] =
            (first_board().forward, 100 << 16, any(), any(), any());
        kani first_board_rotation [unwind(4)] =
            (first_board().rotation, 50 << 16, any(), any(), any());
        kani factors_of_every_size [unwind(4)] =
            (coarse_gains(), 50 << 16, any(), i32::from(any::<i16>()), i32::from(any::<i16>()));
        sampled 500_000;
    }
    T7 limit_change_cuts_the_integral(gains: Gains, before: i32, integral: i32, after: i32) {
        cases ["cut", "kept"];
        kani forward [unwind(4)] = (first_board().forward, any(), any(), any());
        sampled 100_000;
    }
    T7 saturation_ends_at_once(gains: Gains, limit: i32, integral: i32, error: i32) {
        cases ["from the limit", "from the other side"];
        kani first_board_rotation [unwind(4)] =
            (first_board().rotation, 50 << 16, any(), any());
        sampled 500_000;
    }
    T7 sequence_stays_within_the_limit(
        gains: Gains, limit: i32, errors: [u8; 64], scale: u8
    ) {
        cases ["reaches it", "stays below"];
        sampled 50_000;
    }
}

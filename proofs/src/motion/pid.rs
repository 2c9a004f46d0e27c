//! T7: the PID's output and integral stay within its limit for all gains, and leave it in time.

#[cfg(kani)]
use crate::eeprom::accepted::{forward_gains, rotation_gains};
use fixed::types::{I16F16, I32F32};
use fw_core::eeprom::{Gain, Gains};
use fw_core::motion::pid::Pid;

use crate::input::{Input, Source};
use crate::property::Seen;

/// A PID in any state: its only one is the integral, 2⁻³² %, within its limit.
fn pid_with(gains: &Gains, limit: i32, integral: i64) -> Pid {
    Pid::new(gains, I16F16::from_bits(limit)).with_integral(I32F32::from_bits(integral))
}

/// 2⁻³² %.
fn integral_of(pid: &Pid) -> i64 {
    pid.integral().to_bits()
}

/// The limit as the PID clamps it: 0 to 100 %.
fn cut(limit: i32) -> i32 {
    limit.clamp(0, 100 << 16)
}

/// Inductive step: from any integral within the limit, with any error and rate, output and integral are
/// within the limit. No overflow for any gains.
pub fn step_stays_within_the_limit(
    gains: Gains,
    limit: i32,
    integral: i64,
    error: i32,
    rate: i32,
) -> Seen {
    let mut pid = pid_with(&gains, limit, integral);
    let cut = cut(limit);
    let most = i64::from(cut) << 16;
    assert!(integral_of(&pid) == integral.clamp(-most, most));
    let output = pid
        .step(I16F16::from_bits(error), I16F16::from_bits(rate))
        .to_bits();
    assert!(output.abs() <= cut);
    assert!(integral_of(&pid).abs() <= most);
    Seen::NOTHING
        .case(0, output == cut && cut > 0)
        .case(1, output == -cut && cut > 0)
        .case(2, output.abs() < cut && output != 0)
}

/// 2⁻¹⁶ %, rounded down.
fn whole(pid: &Pid) -> i32 {
    i32::try_from(integral_of(pid) >> 16).unwrap_or(i32::MAX)
}

/// Accepted gains, 2⁻³².
struct Factors {
    p: i64,
    i: i64,
    d: i64,
    anti_windup: i64,
}

impl Factors {
    fn of(gains: &Gains) -> Self {
        let bits = |gain: Gain| gain.value().to_bits();
        Self {
            p: bits(gains.p),
            i: bits(gains.i),
            d: bits(gains.d),
            anti_windup: bits(gains.anti_windup),
        }
    }

    /// The proportional part of an error, without its sign, 2⁻¹⁶ % for an error in 2⁻¹⁶.
    fn proportional(&self, error: i32) -> i128 {
        (i128::from(self.p) * i128::from(error).abs()) >> 32
    }
}

/// Saturation ends with the first sample whose proportional and derivative parts sum to the opposite
/// sign, by more than 1/512 %, whatever the integral.
pub fn saturation_ends_at_once(
    gains: Gains,
    limit: i32,
    integral: i64,
    error: i32,
    rate: i32,
) -> Seen {
    let factors = Factors::of(&gains);
    // 2⁻⁴⁸ %.
    let term = |factor: i64, of: i32| i128::from(factor) * i128::from(of);
    let others = term(factors.p, error) - term(factors.d, rate);
    let (back, cut) = (others.abs() > 1 << 39, cut(limit));
    given!(back && cut > 1 << 10);
    let mut pid = pid_with(&gains, limit, integral);
    let output = pid
        .step(I16F16::from_bits(error), I16F16::from_bits(rate))
        .to_bits();
    if others < 0 {
        assert!(output < cut);
    } else {
        assert!(output > -cut);
    }
    let most = i64::from(cut) << 16;
    Seen::NOTHING
        .case(0, others < 0 && integral >= most)
        .case(1, others > 0 && integral <= -most)
        .case(2, others < 0 && integral < 0)
}

/// The excess of the integral decays: n samples of a constant error that keeps the output at its limit
/// leave at most (1 − a)ⁿ of it, to 2⁻¹⁵ %, a the anti wind-up factor, at most 1. The excess is the part
/// of the integral beyond the headroom of the proportional part. On the first board 99 % are gone after
/// 13 samples (forward, 0.3) and all after one (rotation, 1.4).
pub fn windup_is_shed_in_time(
    gains: Gains,
    limit: i32,
    integral: i64,
    error: i32,
    samples: u8,
) -> Seen {
    let factors = Factors::of(&gains);
    given!(error != 0);
    let sign = error.signum();
    let cut = cut(limit);
    let error = I16F16::from_bits(error);
    let mut pid = pid_with(&gains, limit, integral);
    // In 2⁻¹⁶ %; the PID uses 16 fractional bits of the anti wind-up factor.
    let proportional = proportional_part(&gains, error).to_bits() * sign;
    let headroom = (cut - proportional).max(0);
    let shed = (factors.anti_windup >> 16).min(1 << 16);
    let excess = |pid: &Pid| whole(pid) * sign - headroom;
    let before = excess(&pid);
    given!(before > 0);
    let mut most = before;
    for _ in 0..samples {
        let output = pid.step(error, I16F16::ZERO).to_bits();
        most -= ((i64::from(most) * shed) >> 16) as i32;
        assert!(excess(&pid) <= most + 2);
        assert!(output * sign >= cut - 2);
    }
    Seen::NOTHING
        .case(0, samples > 0 && headroom > 0)
        .case(1, samples > 0 && headroom == 0)
        .case(2, samples > 0 && most < before)
}

/// Output of the proportional part alone, up to 100 %.
fn proportional_part(gains: &Gains, error: I16F16) -> I16F16 {
    let gains = Gains {
        p: gains.p,
        ..Gains::default()
    };
    Pid::new(&gains, I16F16::lit("100")).step(error, I16F16::ZERO)
}

/// Every sample whose error opposes the integral, with a proportional part within a fifth of the limit,
/// reduces the integral by I · error, unless the output is at the other limit: the integral's sign changes
/// after at most limit / (I · error) samples.
pub fn integral_turns_in_time(
    gains: Gains,
    limit: i32,
    integral: i64,
    error: i32,
    rate: i32,
    samples: u8,
) -> Seen {
    let factors = Factors::of(&gains);
    let cut = cut(limit);
    // Sign of the integral, opposite to the error's.
    let sign = -error.signum();
    let proportional = factors.proportional(error);
    let mut pid = pid_with(&gains, limit, integral);
    let held = |pid: &Pid| i128::from(whole(pid) * sign);
    let before = held(&pid);
    given!(sign != 0 && before > 0 && proportional + 1 < i128::from(cut / 5));
    // 2⁻³² %.
    let part = (i128::from(factors.i) * i128::from(error).abs()) >> 16;
    let mut left = before << 16;
    let mut held_at_limit = false;
    for _ in 0..samples {
        let output = pid
            .step(I16F16::from_bits(error), I16F16::from_bits(rate))
            .to_bits();
        given!(output * sign != -cut);
        left = (left - part).max(-i128::from(cut) << 16);
        assert!(held(&pid) <= (left >> 16) + 2);
        held_at_limit |= output * sign == cut && part > 0;
    }
    Seen::NOTHING
        .case(0, samples > 0 && left <= 0)
        .case(1, samples > 0 && left > 0 && part > 0)
        .case(2, held_at_limit)
}

/// An error whose proportional part is beyond a fifth of the limit leaves the integral unchanged or
/// nearer to zero.
pub fn far_errors_are_not_integrated(
    gains: Gains,
    limit: i32,
    integral: i64,
    error: i32,
    rate: i32,
) -> Seen {
    let factors = Factors::of(&gains);
    given!(factors.proportional(error) > i128::from(cut(limit) / 5));
    let mut pid = pid_with(&gains, limit, integral);
    let before = integral_of(&pid);
    let _ = pid.step(I16F16::from_bits(error), I16F16::from_bits(rate));
    let after = integral_of(&pid);
    assert!(before.min(0) <= after && after <= before.max(0));
    seen!(after == before && before != 0, after != before)
}

impl Input for Gains {
    fn draw(source: &mut impl Source) -> Self {
        // From tiny to the largest.
        let factor = |source: &mut _| {
            let bits = u64::draw(source) >> 18 >> (u8::draw(source) % 40);
            Gain::new(I32F32::from_bits(bits as i64)).unwrap_or(Gain::MAX)
        };
        Self {
            p: factor(source),
            i: factor(source),
            d: factor(source),
            anti_windup: factor(source),
        }
    }
}

/// A value whose last bits are 0: with more bits the solver takes hours.
#[cfg(kani)]
fn coarse(bits: u32) -> i32 {
    let value: i16 = crate::input::any();
    i32::from(value) << bits
}

crate::properties! {
    theorem T7 step_stays_within_the_limit(
        gains: Gains, limit: i32, integral: i64, error: i32, rate: i32
    ) {
        cases ["at the upper limit", "at the lower limit", "between"];
        kani proof [unwind(4), solver(minisat)];
        sampled 500_000;
    }
    property T7 saturation_ends_at_once(
        gains: Gains, limit: i32, integral: i64, error: i32, rate: i32
    ) {
        cases ["from the upper limit", "from the lower limit", "from the other side"];
        kani first_board_rotation [unwind(4)] =
            (rotation_gains(), 50 << 16, any(), any(), 0);
        kani first_board_braking [unwind(4)] =
            (forward_gains(), 100 << 16, any(), 0, any());
        sampled 500_000;
    }
    property T7 windup_is_shed_in_time(
        gains: Gains, limit: i32, integral: i64, error: i32, samples: u8
    ) {
        cases ["down to the headroom", "down to zero", "reduced"];
        kani first_board_forward [unwind(4)] =
            (forward_gains(), if any() { 100 << 16 } else { 40 << 16 }, any(), 8 << 16, 1);
        kani first_board_rotation [unwind(4)] =
            (rotation_gains(), 50 << 16, i64::from(coarse(8)) << 16, coarse(8), 1);
        sampled 200_000;
    }
    property T7 integral_turns_in_time(
        gains: Gains, limit: i32, integral: i64, error: i32, rate: i32, samples: u8
    ) {
        cases ["spent", "on its way", "held at the limit by the rate"];
        kani first_board_rotation [unwind(4)] =
            (rotation_gains(), 50 << 16, i64::from(coarse(8)) << 16, coarse(4), coarse(12), 1);
        sampled 500_000;
    }
    property T7 far_errors_are_not_integrated(
        gains: Gains, limit: i32, integral: i64, error: i32, rate: i32
    ) {
        cases ["kept", "nearer to zero"];
        kani first_board_forward [unwind(4)] =
            (forward_gains(), 100 << 16, any(), any(), 0);
        sampled 300_000;
    }
}

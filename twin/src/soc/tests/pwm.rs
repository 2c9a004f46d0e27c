use super::*;

const TIM3: u64 = 0x4000_0400;
const TIM4: u64 = 0x4000_0800;
const CR1: u64 = 0;
const CR2: u64 = 4;
const DIER: u64 = 0xC;
const SR: u64 = 0x10;
const EGR: u64 = 0x14;
const CCMR2: u64 = 0x1C;
const CCER: u64 = 0x20;
const CNT: u64 = 0x24;
const PSC: u64 = 0x28;
const ARR: u64 = 0x2C;
const CCR3: u64 = 0x3C;
const CCR4: u64 = 0x40;
/// PWM mode 1 on both channels of `CCMR2`, and the first one's preload.
const PWM: u64 = 0x6060;
const PRELOAD: u64 = 0x08;

fn part() -> Fixture<Stm32f411> {
    let mut part = super::part();
    part.write(APB1ENR, 0b110);
    part
}

/// TIM3 is `rigless`'s timer, written from the same chapter: both answer alike, whatever is written.
#[test]
fn pwm_timer_answers_as_rigless_timer() {
    for seed in 1..=20_u64 {
        let mut random = plant::Rng::new(seed);
        let mut pick = |of: &[u64]| of[random.below(of.len())];
        let mut part = part();
        let mut writes = Vec::new();
        for register in [CCR3, CCR4] {
            part.write(TIM3 + register, 5);
            part.write(TIM4 + register, 5);
        }
        for _ in 0..300 {
            let (offset, value) = match pick(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 8]) {
                0 => (CR1, pick(&[0, 1, 1, 1, 0x81, 0x81, 3, 5])),
                1 => (CCMR2, pick(&[PWM, PWM | PRELOAD, 0x7060, 0x4050])),
                2 => (PSC, pick(&[0, 0, 1, 6])),
                3 => (ARR, pick(&[99, 99, 500, 7])),
                4 => (CCR3, pick(&[1, 3, 6, 7])),
                5 => (CCR4, pick(&[2, 7, 8, 65_535])),
                6 => (SR, pick(&[0, !1, !8])),
                7 => (EGR, pick(&[1, 8])),
                _ => (CCER, 0x1100),
            };
            for timer in [TIM3, TIM4] {
                part.write(timer + offset, value);
            }
            writes.push((part.now.0, offset, value));
            part.run(pick(&[0, 63, 1_000, 6_250, 20_000, 900_000]));
            let compared = [CNT, SR, CR1, ARR, CCR3].map(|offset| {
                // Without the flags of channels 1 and 2, whose value 0 matches at every start.
                [TIM3, TIM4].map(|timer| part.read(timer + offset) & !(6 * u64::from(offset == SR)))
            });
            for [rigless, own] in compared {
                assert_eq!(own, rigless, "seed {seed}: {compared:x?} after {writes:x?}");
            }
        }
    }
}

#[test]
fn pwm_duty_is_share_of_period_and_loads_at_update() {
    let mut part = part();
    for (register, value) in [
        (CCMR2, PWM | PRELOAD),
        (ARR, 99),
        (CCR3, 25),
        (CCR4, 100),
        (CCER, 0x1100),
        (EGR, 1),
        (CR1, 1),
    ] {
        part.write(TIM4 + register, value);
    }
    let duty = |part: &Fixture<Stm32f411>| [3, 4].map(|of| part.mcu.pwm_duty(part.now, of));
    assert_eq!(duty(&part), [Some(0.25), Some(1.0)]);
    assert_eq!(part.mcu.next_event(), None, "nothing polls");
    part.run(1_000);
    part.write(TIM4 + CCR3, 75);
    part.write(TIM4 + CCR4, 0);
    assert_eq!(duty(&part), [Some(0.25), Some(0.0)], "one is preloaded");
    part.run(5_250);
    assert_eq!(duty(&part), [Some(0.75), Some(0.0)]);
    part.write(TIM4 + CCMR2, 0x7058);
    assert_eq!(duty(&part), [Some(1.0), Some(1.0)], "forced, and mode 2");
    part.write(TIM4 + CCER, 0x0300);
    assert_eq!(duty(&part), [Some(0.0), None], "active low, and off");
}

#[test]
fn pwm_timer_reports_what_it_does_not_model() {
    for (register, value) in [
        (DIER, 1),
        (CR2, 0x20),
        (CR1, 0x10),
        (CCMR2, 1),
        (CCMR2, 0x30),
    ] {
        let mut part = part();
        part.write(TIM4 + register, value);
        assert_eq!(objections(&mut part).len(), 1, "{register:#x}");
    }
}

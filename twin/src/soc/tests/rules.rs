use super::i2c::{CCR, CR1, CR2, I2C1};
use super::*;
use rigless::emulator::{Access, AccessKind};

const CFGR: u64 = RCC + 8;
const ACR: u64 = 0x4002_3C00;
const APB1RSTR: u64 = RCC + 0x20;
const APB2LPENR: u64 = RCC + 0x64;
const TIM1_CR1: u64 = 0x4001_0000;
const GPIOA_MODER: u64 = 0x4002_0000;
const GPIOA_OSPEEDR: u64 = GPIOA_MODER + 8;
const GPIOB_MODER: u64 = 0x4002_0400;
const GPIOB_OTYPER: u64 = GPIOB_MODER + 4;
const GPIOB_PUPDR: u64 = GPIOB_MODER + 0xC;
const GPIOB_AFRL: u64 = 0x4002_0420;
const TRISE: u64 = I2C1 + 0x20;
const ADC1: u64 = 0x4001_2000;
const STREAM: u64 = 0x4002_6010;
const PWR: u64 = 0x4000_7000;
const LIFCR: u64 = 0x4002_6008;
const READ: u64 = u64::MAX;

/// What is reported after these accesses, each an address and what is written, or [`READ`].
fn reported(accesses: &[(u64, u64)]) -> Vec<&'static str> {
    let mut part = super::part();
    let enabled = [
        (AHB1ENR, 0x0020_0003),
        (APB1ENR, 1 << 21 | 1 << 28),
        (APB2ENR, 1 << 8),
    ];
    for &(address, value) in enabled.iter().chain(accesses) {
        let (kind, answer) = if value == READ {
            (AccessKind::Read, part.read(address))
        } else {
            part.write(address, value);
            (AccessKind::Write, value)
        };
        let mut access = Access::new(kind, address, Width::W32, value);
        access.program_counter = Some(0);
        part.mcu.check_access(&access, answer);
        part.act(Stm32f411::poll);
    }
    objections(&mut part)
}

/// A stream that receives, stopped with items left.
const STOPPED: [(u64, u64); 3] = [(STREAM + 4, 3), (STREAM, 1), (STREAM, 0)];
/// I2C1 at 16 MHz with its pins connected: 400 kHz within the specification, and SWRST.
const I2C: [(u64, u64); 8] = [
    (GPIOB_MODER, 0xA280),
    (GPIOB_AFRL, 0x4400_0000),
    (CR1, 1 << 15),
    (CR1, 0),
    (CR2, 16),
    (CCR, 0x800E),
    (TRISE, 5),
    (GPIOB_OTYPER, 0xC0),
];
/// A scan of IN0 and IN1 with 480 cycles of 4 MHz.
const ADC: [(u64, u64); 4] = [
    (GPIOA_MODER, 0xF),
    (ADC1 + 0x10, 0o77),
    (ADC1 + 0x2C, 1 << 20),
    (ADC1 + 0x34, 1 << 5),
];
const SWSTART: (u64, u64) = (ADC1 + 8, 1 << 30 | 1);

#[test]
fn forbidden_accesses_are_reported_and_right_ones_not() {
    type Accesses = [(u64, u64)];
    type Case = (Vec<(u64, u64)>, &'static Accesses, &'static [&'static str]);
    let instead = |accesses: &Accesses, nth: usize, value: u64| {
        let mut changed = accesses.to_vec();
        changed[nth].1 = value;
        changed
    };
    let cases: [Case; 24] = [
        (
            STOPPED.into(),
            &[(STREAM, READ), (LIFCR, 0x3D), (STREAM + 4, 8), (STREAM, 1)],
            &[],
        ),
        (
            STOPPED.into(),
            &[(STREAM, READ), (STREAM + 4, 8)],
            &["SxCR"],
        ),
        (STOPPED.into(), &[(LIFCR, 0x3D), (STREAM + 4, 8)], &["SxCR"]),
        (STOPPED.into(), &[(STREAM, 1)], &["SxCR"]),
        (
            vec![(STREAM + 4, 3), (STREAM, 1)],
            &[(STREAM, READ)],
            &["SxCR"],
        ),
        (I2C.into(), &[(CR1, 1)], &[]),
        (instead(&I2C, 2, 0), &[(CR1, 1)], &["CR1"]),
        (
            I2C.into(),
            &[(GPIOB_MODER, 0), (GPIOB_MODER, 0xA280), (CR1, 1)],
            &["CR1"],
        ),
        (instead(&I2C, 4, 50), &[(CR1, 1)], &["CR2"]),
        (instead(&I2C, 5, 0x800A), &[(CR1, 1)], &["CCR"]),
        (instead(&I2C, 6, 1), &[(CR1, 1)], &["TRISE"]),
        (I2C.into(), &[(CR1, 1), (GPIOB_MODER, 0)], &["CR1"]),
        (instead(&I2C, 7, 0x40), &[(CR1, 1)], &["OTYPER"]),
        (
            instead(&I2C, 7, 0x80),
            &[(GPIOB_MODER, 0x5280)],
            &["OTYPER"],
        ),
        (
            vec![(PWR, 3 << 14), (RCC, 0x0100_0083)],
            &[(PWR, 3 << 14)],
            &[],
        ),
        (vec![(RCC, 0x0100_0083)], &[(PWR, 3 << 14)], &["CR"]),
        // PB0 carries an echo, PB1 does not.
        (
            vec![(GPIOB_PUPDR, 0b0100), (GPIOB_PUPDR, 0b0001)],
            &[],
            &["PUPDR"],
        ),
        (vec![(APB1RSTR, 1 << 21), (CR2, 16)], &[], &["any"]),
        (vec![(APB1RSTR, 1 << 21), (APB1RSTR, 0)], &[(CR2, 16)], &[]),
        (vec![(APB2ENR, 1), (APB2LPENR, 1)], &[(TIM1_CR1, 1)], &[]),
        (vec![(APB2ENR, 1)], &[(TIM1_CR1, 1)], &["CR1"]),
        (ADC.into(), &[SWSTART], &[]),
        (instead(&ADC, 0, 3), &[SWSTART], &["CR2"]),
        (instead(&ADC, 1, 0), &[SWSTART], &["CR2", "CR2"]),
    ];
    for (set_up, then, expected) in cases {
        let accesses = [&set_up[..], then].concat();
        assert_eq!(reported(&accesses), expected, "{accesses:x?}");
    }
}

/// The PLL at 100 MHz needs scale 1, three wait states and APB1 at half its clock.
#[test]
fn clocks_beyond_limits_of_part_are_reported() {
    let cases: [(u64, u64, u64, &[&str]); 4] = [
        (3, 3, 0x1002, &[]),
        (3, 3, 0x0002, &["CFGR"]),
        (2, 3, 0x1002, &["CFGR"]),
        (3, 2, 0x1002, &["CFGR"]),
    ];
    for (scale, wait_states, cfgr, expected) in cases {
        let mut part = super::part();
        part.write(APB1ENR, 1 << 28);
        part.write(PWR, scale << 14);
        part.write(ACR, wait_states);
        part.write(RCC + 4, 0x0500_1908);
        part.write(RCC, 0x0100_0083);
        part.act(Stm32f411::poll);
        part.run(1_000_000);
        part.act(Stm32f411::poll);
        part.write(CFGR, cfgr);
        part.run(1_000_000);
        part.act(Stm32f411::poll);
        assert_eq!(
            objections(&mut part),
            expected,
            "{scale} {wait_states} {cfgr:#x}"
        );
    }
}

#[test]
fn crystal_and_pll_become_ready_after_their_time() {
    const HSE: (u64, u64) = (1 << 16, 1 << 17);
    const PLL: (u64, u64) = (1 << 24, 1 << 25);
    for ((on, ready), crystal, early_us, late_us) in [
        (HSE, 8_000_000, 300, Some(330)),
        (PLL, 8_000_000, 40, Some(50)),
        (HSE, 0, 300, None),
    ] {
        let mut part = super::part();
        part.mcu.rcc.attach_crystals(crystal, 0);
        part.write(RCC, 0x83 | on);
        let mut is_ready_at = |us: u64| {
            part.act(Stm32f411::poll);
            part.run(us * 1_000);
            part.act(Stm32f411::poll);
            part.read(RCC) & ready != 0
        };
        assert!(!is_ready_at(early_us));
        let late = late_us.map_or(10_000, |us| us - early_us);
        assert_eq!(is_ready_at(late), late_us.is_some());
    }
}

/// Out of reset APB2 runs at 16 MHz: half of it is the slave's limit, 94 ns its set-up time; the pad of MISO is
/// too slow from there on unless its edges are fast.
#[test]
fn master_that_the_spi_slave_cannot_follow_is_reported() {
    for (fast, hz, selected_ns, expected) in [
        (true, 8_000_000, 94, 0),
        (true, 8_000_001, 94, 1),
        (true, 8_000_000, 93, 1),
        (false, 8_000_000, 94, 0),
        (false, 8_000_001, 94, 2),
    ] {
        let mut part = super::part();
        part.write(AHB1ENR, 1);
        part.write(GPIOA_OSPEEDR, u64::from(fast) << 12);
        part.act(|part, now| part.check_spi(now, hz, selected_ns));
        assert_eq!(
            objections(&mut part).len(),
            expected,
            "{fast} {hz} {selected_ns}"
        );
    }
}

//! Disturbances of a Guarded Normal frame on the link's wires, drawn at random.

use std::ops::Range;

use plant::Rng;
use twin::SpiStep;

use crate::throughput::GAP_NS;
use crate::wires::selected;

/// From the chip select's edge to the clocks, and back, nanoseconds.
pub const SETUPS_NS: [u64; 4] = [60, 250, 500, 1_000];
/// Bytes of a Guarded Normal frame.
pub const LEN: usize = 26;
const BITS: usize = 8 * LEN;
/// Clock rates, hertz, and how often each comes: the slow ones take the most time.
const CLOCKS: [(u64, usize); 8] = [
    (100_000, 1),
    (400_000, 1),
    (1_000_000, 2),
    (4_000_000, 4),
    (8_000_000, 8),
    (12_000_000, 8),
    (16_000_000, 8),
    (25_000_000, 8),
];
/// Wrong bits, of a million.
const RATES: [u64; 5] = [1, 10, 100, 1_000, 10_000];

/// The seeds `A..B` of an environment variable.
pub fn seeds(variable: &str) -> Option<Range<u64>> {
    let seeds = std::env::var(variable).ok()?;
    let (first, end) = seeds.split_once("..").expect("A..B");
    let number = |text: &str| text.parse().expect("a number");
    Some(number(first)..number(end))
}

/// Random numbers.
pub struct Random(pub Rng);

impl Random {
    /// 0 ..= below − 1.
    pub fn below(&mut self, below: usize) -> usize {
        let scaled = (u128::from(self.0.next_u64()) * below as u128) >> 64;
        usize::try_from(scaled).expect("below a usize")
    }

    fn clock(&mut self) -> u64 {
        let clocks = CLOCKS.iter().flat_map(|&(hz, often)| [hz].repeat(often));
        let clocks: Vec<u64> = clocks.collect();
        clocks[self.below(clocks.len())]
    }

    /// The bits of a frame that are wrong at a rate; one less where the checksum cannot tell, which is so
    /// for one in some 32 000 patterns of an even number.
    fn wrong_bits(&mut self, of_a_million: u64) -> Vec<usize> {
        let wrong = |_: &usize| (self.below(1_000_000) as u64) < of_a_million;
        let mut bits: Vec<_> = (0..BITS).filter(wrong).collect();
        let remainder = (0..BITS).fold(0_u16, |crc, bit| {
            let shifted = crc << 1 | u16::from(bits.contains(&bit));
            shifted ^ if crc >> 15 == 1 { 0x1021 } else { 0 }
        });
        if remainder == 0 {
            bits.pop();
        }
        bits
    }
}

/// The disturbance of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// None.
    Good,
    /// Ends before its last byte.
    Short(usize),
    /// Goes on after its last byte.
    Long(usize),
    /// Ends inside a byte, after so many bits.
    Torn(usize),
    /// The chip select falls and rises, and nothing is clocked.
    Glitch,
    /// The chip select rises for a microsecond after so many bits.
    Split(usize),
    /// These bits arrive wrong at the STM, those at the Pi.
    Noise(Vec<usize>, Vec<usize>),
}

impl Disturbance {
    /// Any but [`Disturbance::Good`].
    #[must_use]
    pub fn bad(random: &mut Random) -> Self {
        match random.below(8) {
            0 => Self::Short(1 + random.below(LEN - 1)),
            1 => Self::Long(1 + random.below(64)),
            2 => Self::Torn(8 * random.below(LEN) + 1 + random.below(7)),
            3 => Self::Glitch,
            4 => Self::Split(8 + random.below(BITS - 16)),
            _ => {
                let rate = RATES[random.below(RATES.len())];
                Self::Noise(random.wrong_bits(rate), random.wrong_bits(rate))
            }
        }
    }

    /// Whether the STM receives the frame unchanged.
    #[must_use]
    pub fn reaches_the_stm_whole(&self) -> bool {
        match self {
            Self::Good => true,
            Self::Noise(there, _) => there.is_empty(),
            _ => false,
        }
    }

    /// Whether the Pi receives the reply unchanged.
    #[must_use]
    pub fn reaches_the_pi_whole(&self) -> bool {
        match self {
            Self::Good => true,
            Self::Noise(_, back) => back.is_empty(),
            _ => false,
        }
    }

    /// Frames that the STM rejects of it.
    #[must_use]
    pub fn rejections(&self) -> usize {
        match self {
            Self::Split(_) => 2,
            _ => usize::from(!self.reaches_the_stm_whole()),
        }
    }

    /// Its kind.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Short(_) => "short",
            Self::Long(_) => "long",
            Self::Torn(_) => "torn",
            Self::Glitch => "glitch",
            Self::Split(_) => "split",
            Self::Noise(there, _) if !there.is_empty() => "noise to the STM",
            Self::Noise(_, back) if !back.is_empty() => "noise to the Pi",
            Self::Noise(..) => "noise that spared it",
        }
    }

    /// Puts `frame` on the wires at a random clock and set-up time, the guaranteed gap after the one before.
    pub fn play(&self, frame: &[u8], random: &mut Random) -> Vec<SpiStep> {
        let (hz, setup_ns) = (random.clock(), SETUPS_NS[random.below(SETUPS_NS.len())]);
        let mut bytes = frame.to_vec();
        if let Self::Long(more) = self {
            bytes.extend((0..*more).map(|_| random.0.next_u64().to_le_bytes()[0]));
        }
        let SpiStep::Bits { mut mosi, .. } = SpiStep::bytes(&bytes, hz) else {
            unreachable!("bytes are bits")
        };
        let mut rest = None;
        match self {
            Self::Short(less) => mosi.truncate(8 * (LEN - less)),
            Self::Torn(bits) => mosi.truncate(*bits),
            Self::Split(bits) => rest = Some(mosi.split_off(*bits)),
            Self::Noise(there, _) => there.iter().for_each(|&bit| mosi[bit] ^= true),
            _ => {}
        }
        let mut steps = Vec::new();
        for (mosi, wait) in [(Some(mosi), GAP_NS), (rest, 1_000)] {
            let Some(mosi) = mosi else { continue };
            steps.push(SpiStep::Wait(wait));
            match self {
                Self::Glitch => {
                    let [begin, end] = [true, false].map(SpiStep::Select);
                    steps.extend([begin, SpiStep::Wait(200), end]);
                }
                _ => steps.extend(selected(setup_ns, SpiStep::Bits { mosi, hz })),
            }
        }
        steps
    }
}

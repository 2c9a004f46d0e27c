//! What a release ELF is made of: sizes, symbols, vectors, texts.

use std::collections::BTreeSet;

use object::elf::SHF_ALLOC;
use object::read::elf::ElfFile32;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SectionFlags};

use crate::error::{Context, Result};

/// A 32-bit ELF in memory.
pub struct Elf<'a>(ElfFile32<'a, Endianness>);

/// What an ELF occupies on the chip, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Vectors, code, constants and the initial values of statics.
    pub flash: u64,
    /// Statics, zeroed, initialised or left as they are; not the stack.
    pub ram: u64,
}

const FLASH: std::ops::Range<u64> = 0x0800_0000..0x0808_0000;
const RAM: std::ops::Range<u64> = 0x2000_0000..0x2002_0000;

impl<'a> Elf<'a> {
    pub fn parse(bytes: &'a [u8]) -> Result<Self> {
        let file = ElfFile32::parse(bytes);
        file.map(Self).context("the firmware is no readable ELF")
    }

    /// Sums the sections that are loaded, and those that live in RAM.
    pub fn sizes(&self) -> Sizes {
        let mut sizes = Sizes::default();
        for section in self.0.sections().filter(allocated) {
            if section.file_range().is_some() {
                sizes.flash += section.size();
            }
            if RAM.contains(&section.address()) {
                sizes.ram += section.size();
            }
        }
        sizes
    }

    /// The mangled names of all symbols that are defined in it.
    pub fn symbols(&self) -> BTreeSet<&'a str> {
        let defined = self.0.symbols().filter(|symbol| !symbol.is_undefined());
        defined.filter_map(|symbol| symbol.name().ok()).collect()
    }

    /// What is wrong with the vector table: entries that can be taken but are not handled.
    pub fn bad_vectors(&self) -> Result<Vec<String>> {
        let mut tables = self.0.sections().filter(allocated);
        let table = tables.find(|found| found.address() == FLASH.start && found.size() >= 64);
        let table = table.and_then(|table| table.data().ok());
        let table = table.context("no vector table at the start of the flash (0x08000000)")?;
        let words = table.chunks_exact(4);
        let words = words.map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
        Ok(judge_vectors(&words.collect::<Vec<_>>()))
    }
}

fn allocated<'a>(section: &impl ObjectSection<'a>) -> bool {
    matches!(section.flags(), SectionFlags::Elf { sh_flags, .. } if sh_flags.contains(SHF_ALLOC))
}

/// System exceptions of the Cortex-M4 and interrupts of the STM32F411 (RM0383, table 37): the last
/// is SPI5, number 85.
const VECTORS: usize = 16 + 86;

/// Entries that the processor (`ARMv7`-M, B1.5.2) or RM0383, table 37 reserve: nothing raises them.
fn reserved(entry: usize) -> bool {
    match entry.checked_sub(16) {
        None => matches!(entry, 7..=10 | 13),
        Some(19..=22 | 39 | 43..=46 | 48 | 52..=55 | 61..=66 | 74..=80 | 82 | 83) => true,
        Some(_) => false,
    }
}

fn judge_vectors(words: &[u32]) -> Vec<String> {
    let mut wrong = Vec::new();
    if words.len() < VECTORS {
        let count = words.len();
        wrong.push(format!("the vector table has {count} entries of {VECTORS}"));
    }
    for (entry, &word) in words.iter().take(VECTORS).enumerate() {
        let good = match entry {
            0 => word % 8 == 0 && (RAM.start..=RAM.end).contains(&u64::from(word)),
            _ if word == 0 => reserved(entry),
            _ => word % 2 == 1 && FLASH.contains(&u64::from(word)),
        };
        if !good {
            wrong.push(format!("vector {entry} is {word:#010x}"));
        }
    }
    wrong
}

/// Everything a proven core has no use for, and the pieces of mangled names (of the old and of the new
/// mangling, parted by blanks) that show it.
const BANNED: [(&str, &str); 4] = [
    (
        "a panic path",
        "4core9panicking rust_begin_unwind _fail17h unwrap_failed expect_failed slice_error_fail \
         10panic_impl",
    ),
    ("text formatting", "4core3fmt 3fmt9Formatter 3fmt5write"),
    (
        "a software floating-point helper",
        "__aeabi_d __aeabi_f2d __aeabi_i2d __aeabi_ui2d __aeabi_l2d __aeabi_ul2d __aeabi_cd \
         __aeabi_f __adddf3 __subdf3 __muldf3 __divdf3 __extendsfdf2 __truncdfsf2 __floatsidf \
         __floatunsidf __floatdidf __floatundidf __fixdfsi __fixdfdi __fixunsdfsi __fixunsdfdi \
         __gedf2 __ledf2 __eqdf2 __unorddf2",
    ),
    (
        "a heap",
        "__rust_alloc __rust_dealloc __rg_alloc 5alloc5 _5alloc malloc",
    ),
];

/// The symbols of code that must not be in the release ELF, each with the kind of code before it.
// Requirement: DOC-3.1-2
pub fn banned(symbols: &BTreeSet<&str>) -> Vec<String> {
    let mut found = Vec::new();
    for (kind, pieces) in BANNED {
        let shows = |symbol: &&&str| pieces.split(' ').any(|piece| symbol.contains(piece));
        let symbols = symbols.iter().filter(shows);
        found.extend(symbols.map(|symbol| format!("{kind}: {symbol}")));
    }
    found
}

// Requirement: WIRE-safe-1
#[test]
fn open_vector_or_wrong_stack_start_is_named() {
    let vector = |entry| if reserved(entry) { 0 } else { 0x0800_0201 };
    let mut words: Vec<_> = (0..VECTORS).map(vector).collect();
    for start in [0, 0x0800_0000, 0x2001_fffc, 0x2002_0008] {
        words[0] = start;
        assert_eq!(judge_vectors(&words).len(), 1, "{start:#x}");
    }
    words[0] = 0x2002_0000;
    assert!(judge_vectors(&words).is_empty());
    (words[3], words[16 + 35]) = (0x0800_0200, 0);
    assert_eq!(judge_vectors(&words).len(), 2);
    // One more finding: the table is too short.
    assert_eq!(judge_vectors(&words[..90]).len(), 3);
}

// Requirement: DOC-3.1-2
#[test]
fn banned_symbol_is_found_in_both_manglings() {
    let symbols = "_ZN4core9panicking9panic_fmt17h0123456789abcdefE \
        _RNvNtCs1234_4core9panicking5panic _RNvNtCs1234_4core3fmt5write __aeabi_dadd \
        __aeabi_memcpy __aeabi_uldivmod _RNvCs_6fw_pac4main";
    let found = banned(&symbols.split(' ').collect());
    let of = |(kind, _)| found.iter().filter(|found| found.starts_with(kind)).count();
    assert_eq!(BANNED.map(of), [2, 1, 1, 0]);
}

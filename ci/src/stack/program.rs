//! The firmware as the processor finds it: code, constants, vectors, and the names of addresses.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use object::read::elf::ElfFile32;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::thumb::{decode, Instruction, What};
use crate::error::{failed, Error, Result};

/// Where the STM32F411RE's flash and RAM begin (DS10314, 5).
pub const FLASH: u32 = 0x0800_0000;
pub const RAM: u32 = 0x2000_0000;

/// Code, constants, names.
#[derive(Debug, Default)]
pub struct Program {
    /// What is loaded into the flash, by address.
    pub flash: Vec<(u32, Vec<u8>)>,
    /// The stretches of code in it; what lies between them is data.
    pub code: Vec<Range<u32>>,
    /// Functions by their first instruction.
    pub names: BTreeMap<u32, String>,
    /// The words of the literal pools.
    pub literals: BTreeSet<u32>,
    /// The vector table's entries.
    pub vectors: Vec<u32>,
    /// Where the stack begins, and where it may end.
    pub stack: Range<u32>,
    /// The lowest address of a static.
    pub statics: u32,
}

impl Program {
    /// # Errors
    /// Where the file lacks what the analysis stands on: sections, symbols, mapping symbols.
    pub fn of(bytes: &[u8]) -> Result<Self> {
        let file: ElfFile32<Endianness> = ElfFile32::parse(bytes)
            .map_err(|error| Error::Failed(format!("the firmware is no readable ELF: {error}")))?;
        let mut program = Self {
            statics: u32::MAX,
            ..Self::default()
        };
        for section in file.sections() {
            let at = narrow(section.address());
            if section.address() < u64::from(FLASH) || section.size() == 0 {
                continue;
            }
            if at >= RAM {
                program.statics = program.statics.min(at);
            } else if let Ok(data) = section.data() {
                program.flash.push((at, data.to_vec()));
            }
        }
        program.read_symbols(&file)?;
        program.vectors = program.words(FLASH)?;
        program.find_literals();
        Ok(program)
    }

    fn read_symbols(&mut self, file: &ElfFile32<'_, Endianness>) -> Result<()> {
        let mut marks = BTreeMap::new();
        for symbol in file.symbols() {
            let (Ok(name), at) = (symbol.name(), narrow(symbol.address())) else {
                continue;
            };
            match name {
                "_stack_start" => self.stack.end = at,
                "_stack_end" => self.stack.start = at,
                _ => {}
            }
            // ELF for the Arm Architecture, 5.5.5: where code begins, and where data does.
            if let Some(code) = mapping(name) {
                marks.insert(at, code);
            } else if symbol.kind() == SymbolKind::Text && at >= FLASH {
                let name = format!("{:#}", rustc_demangle::demangle(name));
                let known = self.names.entry(at & !1).or_insert_with(|| name.clone());
                // Of a function's aliases the one that says most to a reader.
                if symbol.size() > 0 && known.starts_with("__aeabi") {
                    *known = name;
                }
            }
        }
        if self.names.is_empty() || marks.is_empty() {
            return failed("the ELF has no symbols to find its functions by");
        }
        for (start, data) in &self.flash {
            let end = start + narrow(data.len() as u64);
            let mut within = marks.range(start..&end).peekable();
            while let Some((&at, &code)) = within.next() {
                let next = within.peek().map_or(end, |(&next, _)| next);
                if code {
                    self.code.push(at..next);
                }
            }
        }
        Ok(())
    }

    /// The words from `at` to the end of its section.
    fn words(&self, at: u32) -> Result<Vec<u32>> {
        let section = self.flash.iter().find(|(start, _)| *start == at);
        let Some((_, data)) = section else {
            return failed("no vector table at the start of the flash");
        };
        let words = data.chunks_exact(4);
        Ok(words
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
            .collect())
    }

    /// Every word that an instruction loads from beside the code.
    fn find_literals(&mut self) {
        for range in self.code.clone() {
            let mut at = range.start;
            while at < range.end {
                let Some(instruction) = self.instruction(at) else {
                    break;
                };
                if let What::Literal { address, .. } = instruction.what {
                    self.literals.insert(address);
                }
                at += instruction.length;
            }
        }
    }

    /// Whether `at` is code.
    pub fn is_code(&self, at: u32) -> bool {
        self.code.iter().any(|range| range.contains(&at))
    }

    /// The instruction at `at`; none where that is no code.
    pub fn instruction(&self, at: u32) -> Option<Instruction> {
        if !at.is_multiple_of(2) || !self.is_code(at) {
            return None;
        }
        let first = self.half(at)?;
        Some(decode(at, first, self.half(at + 2).unwrap_or_default()))
    }

    fn bytes<const N: usize>(&self, at: u32) -> Option<[u8; N]> {
        self.flash.iter().find_map(|(start, data)| {
            let from = usize::try_from(at.checked_sub(*start)?).ok()?;
            data.get(from..from.checked_add(N)?)?.try_into().ok()
        })
    }

    /// A byte of the flash.
    pub fn byte(&self, at: u32) -> Option<u8> {
        self.bytes::<1>(at).map(|[byte]| byte)
    }

    /// A halfword of the flash.
    pub fn half(&self, at: u32) -> Option<u16> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    /// A word of the flash.
    pub fn word(&self, at: u32) -> Option<u32> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    /// The function an address lies in.
    pub fn name(&self, at: u32) -> String {
        match self.names.range(..=at).next_back() {
            Some((&start, name)) if start == at => name.clone(),
            Some((&start, name)) => format!("{name}+{:#x}", at - start),
            None => format!("{at:#010x}"),
        }
    }
}

/// Whether a name is a mapping symbol: code (`true`) or data.
fn mapping(name: &str) -> Option<bool> {
    let is = |mark: &str| {
        name == mark
            || name
                .strip_prefix(mark)
                .is_some_and(|rest| rest.starts_with('.'))
    };
    match (is("$t"), is("$d")) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => None,
    }
}

fn narrow(address: u64) -> u32 {
    u32::try_from(address).unwrap_or(u32::MAX)
}

//! The code, constants and names of an ELF.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use object::elf::{EM_ARM, SHF_ALLOC, SHF_WRITE};
use object::read::elf::{ElfFile32, FileHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SectionFlags, SymbolKind};

use crate::Error;
use crate::decode::{Decoder, Effect, Instruction};

/// A program to analyse.
#[derive(Debug, Default)]
pub struct Program {
    /// Constant memory by address.
    memory: Vec<(u32, Vec<u8>)>,
    /// The instructions by address.
    code: BTreeMap<u32, Instruction>,
    /// Functions by their first instruction.
    names: BTreeMap<u32, String>,
    /// The words of the literal pools.
    pub(crate) literals: BTreeSet<u32>,
    /// The vector table: the initial stack pointer, then the handlers; 0 is unused.
    pub(crate) vectors: Vec<u32>,
    /// The addresses reserved for the stack.
    pub(crate) stack: Range<u32>,
    /// The lowest address of a static variable.
    pub(crate) statics: u32,
}

impl Program {
    /// Reads an ELF for a Cortex-M with symbols and mapping symbols (`$t`, `$d`).
    ///
    /// # Errors
    /// [`Error::Elf`] where it is none, or lacks what the analysis needs.
    pub fn from_elf(bytes: &[u8]) -> Result<Self, Error> {
        let file: ElfFile32<Endianness> =
            ElfFile32::parse(bytes).map_err(|error| Error::Elf(error.to_string()))?;
        if file.elf_header().e_machine(Endianness::Little) != EM_ARM {
            return Err(Error::Elf("not for ARM".into()));
        }
        let mut program = Self {
            statics: u32::MAX,
            ..Self::default()
        };
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else {
                continue;
            };
            let at = low(section.address());
            if !sh_flags.contains(SHF_ALLOC) || section.size() == 0 {
                continue;
            }
            if sh_flags.contains(SHF_WRITE) {
                program.statics = program.statics.min(at);
            } else if let Ok(data) = section.data() {
                program.memory.push((at, data.to_vec()));
            }
        }
        let mut symbols = BTreeMap::new();
        let mut marks = BTreeMap::new();
        for symbol in file.symbols() {
            let (Ok(name), at) = (symbol.name(), low(symbol.address())) else {
                continue;
            };
            symbols.insert(name, at);
            // ELF for the Arm Architecture, 5.5.5: the start of code, and of data.
            if let Some(code) = mapping(name) {
                marks.insert(at, code);
            } else if symbol.kind() == SymbolKind::Text {
                let name = format!("{:#}", rustc_demangle::demangle(name));
                let known = program.names.entry(at & !1).or_insert_with(|| name.clone());
                if symbol.size() > 0 && known.starts_with("__aeabi") {
                    *known = name;
                }
            }
        }
        let symbol = |names: &[&str]| names.iter().find_map(|name| symbols.get(name).copied());
        let lacks = |what: &str| Error::Elf(format!("no {what}"));
        let stack = symbol(&["_stack_end"]).zip(symbol(&["_stack_start"]));
        let (end, top) = stack.ok_or_else(|| lacks("symbols _stack_start and _stack_end"))?;
        program.stack = end..top;
        let table = symbol(&["__vector_table", "__RESET_VECTOR", "__isr_vector"]);
        // cortex-m-rt's symbol is that of the reset vector, the second entry.
        let table = table.map(|at| at & !7);
        let vectors = table.and_then(|at| program.table(at, &marks));
        program.vectors = vectors.ok_or_else(|| lacks("vector table"))?;
        if program.names.is_empty() || marks.is_empty() {
            return Err(lacks("function symbols and mapping symbols"));
        }
        program.decode(&marks)?;
        Ok(program)
    }

    /// An empty program, to be filled by [`Self::add_code`]: its stack, and the vector table from
    /// the reset handler on.
    pub fn new(stack: Range<u32>, handlers: &[u32]) -> Self {
        Self {
            vectors: [&[stack.end], handlers].concat(),
            statics: stack.end,
            stack,
            ..Self::default()
        }
    }

    /// A function assembled by hand, for examples and tests.
    ///
    /// # Errors
    /// [`Error::Disassembler`] where Capstone cannot be set up.
    pub fn add_code(&mut self, at: u32, name: &str, halfwords: &[u16]) -> Result<(), Error> {
        let bytes = halfwords.iter().flat_map(|half| half.to_le_bytes());
        self.memory.push((at, bytes.collect()));
        self.names.insert(at, name.to_owned());
        self.decode(&BTreeMap::from([(at, true)]))
    }

    /// Constants, for examples and tests.
    pub fn add_data(&mut self, at: u32, bytes: Vec<u8>) {
        self.memory.push((at, bytes));
    }

    /// Decodes what the marks call code.
    fn decode(&mut self, marks: &BTreeMap<u32, bool>) -> Result<(), Error> {
        let decoder = Decoder::new()?;
        for (start, data) in &self.memory {
            let end = start.saturating_add(low(data.len() as u64));
            for (&mark, _) in marks.range(start..&end).filter(|(_, code)| **code) {
                let until = marks.range(mark + 1..end).next();
                let until = until.map_or(end, |(&next, _)| next);
                let mut at = mark;
                let offset = |at: u32| usize::try_from(at - start).unwrap_or(usize::MAX);
                while at < until {
                    let code = data.get(offset(at)..offset(until)).unwrap_or_default();
                    let Some(instruction) = decoder.decode(at, code) else {
                        break;
                    };
                    if let Effect::LoadLiteral(_, address) = instruction.effect {
                        self.literals.insert(address);
                    }
                    self.code.insert(at, instruction);
                    at += instruction.length;
                }
            }
        }
        Ok(())
    }

    /// The words from `at` to the section's end or to code.
    fn table(&self, at: u32, marks: &BTreeMap<u32, bool>) -> Option<Vec<u32>> {
        let code = marks.range(at..).find(|(_, code)| **code);
        let end = code.map_or(u32::MAX, |(&code, _)| code);
        let words = (at..end).step_by(4).map_while(|at| self.word(at));
        Some(words.collect()).filter(|words: &Vec<u32>| words.len() > 1)
    }

    /// The instruction at `at`; `None` where that is not the start of one.
    pub(crate) fn instruction(&self, at: u32) -> Option<Instruction> {
        self.code.get(&at).copied()
    }

    /// So many bytes of constant memory, at most four, as a number.
    pub(crate) fn number(&self, at: u32, size: u32) -> Option<u32> {
        let bytes = self.memory.iter().find_map(|(start, data)| {
            let from = usize::try_from(at.checked_sub(*start)?).ok()?;
            data.get(from..)?.get(..usize::try_from(size).ok()?)
        })?;
        Some((bytes.iter().rev()).fold(0, |number, byte| number << 8 | u32::from(*byte)))
    }

    /// A word of constant memory.
    pub(crate) fn word(&self, at: u32) -> Option<u32> {
        self.number(at, 4)
    }

    /// The function an address lies in.
    pub(crate) fn name(&self, at: u32) -> String {
        match self.names.range(..=at).next_back() {
            Some((&start, name)) if start == at => name.clone(),
            Some((&start, name)) => format!("{name}+{:#x}", at - start),
            None => format!("{at:#010x}"),
        }
    }

    /// The function whose demangled name is, or ends in `::`, this path.
    pub(crate) fn function(&self, path: &str) -> Option<u32> {
        let tail = format!("::{path}");
        let fits = |name: &str| name == path || name.ends_with(&tail);
        let found = self.names.iter().find(|(_, name)| fits(name));
        found.map(|(&at, _)| at)
    }
}

/// Whether a name is a mapping symbol: of code (`true`) or of data.
fn mapping(name: &str) -> Option<bool> {
    match name.split('.').next().unwrap_or_default() {
        "$t" => Some(true),
        "$d" => Some(false),
        _ => None,
    }
}

fn low(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

//! The functions of an ELF file: where their instructions are, and by which they return.

use std::collections::BTreeSet;

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::thumb::{Flow, flow, halfwords};

/// An instruction of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Where it begins.
    pub address: u64,
    /// Its one or two halfwords; behind the one, anything.
    pub halfwords: [u16; 2],
}

/// A function of the firmware.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Function {
    /// Its demangled path without the crate's hash.
    pub name: String,
    /// Its first instruction.
    pub address: u64,
    /// Its instructions.
    pub instructions: Vec<Instruction>,
    /// The instructions it returns by.
    pub returns: Vec<u64>,
    /// The jumps out of it (tail calls), and what they jump to.
    pub tail_calls: Vec<(u64, u64)>,
}

/// A function to be traced, and the functions it may end in by tail calls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TracedFunction {
    pub(super) functions: Vec<Function>,
}

/// A function cannot be traced.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TraceError {
    /// The file is no ELF file.
    #[error("cannot read the firmware's ELF file: {0}")]
    Elf(String),
    /// No symbol has this name.
    #[error("the firmware has no function {0}")]
    NoFunction(String),
}

impl TracedFunction {
    /// The function whose path ends with `name` (`robot_tick`, `Odometry::step`).
    ///
    /// # Errors
    /// When the ELF file has none.
    pub fn find(elf: &[u8], name: &str) -> Result<Self, TraceError> {
        let all = functions(elf)?;
        let matches = |function: &&Function| {
            let start = function.name.strip_suffix(name);
            start.is_some_and(|start| start.is_empty() || start.ends_with("::"))
        };
        let exact = all.iter().find(|function| function.name == name);
        let root = exact.or_else(|| all.iter().find(matches));
        let root = root.ok_or_else(|| TraceError::NoFunction(name.to_owned()))?;
        let mut functions = vec![root.clone()];
        let mut calls = root.tail_calls.clone();
        while let Some((_, to)) = calls.pop() {
            let is_new = functions.iter().all(|known| known.address != to);
            if let Some(target) = all.iter().find(|f| is_new && f.address == to) {
                functions.push(target.clone());
                calls.extend(&target.tail_calls);
            }
        }
        Ok(Self { functions })
    }

    /// Every instruction to watch, once: the first one, and each that returns or leaves by a tail call.
    pub(crate) fn watched(&self) -> BTreeSet<u64> {
        let ends = self.functions.iter().flat_map(|function| {
            let leaves = function.tail_calls.iter().map(|(at, _)| *at);
            function.returns.iter().copied().chain(leaves)
        });
        ends.chain([self.functions[0].address]).collect()
    }
}

/// Every function of an ELF file, by address.
///
/// # Errors
/// When it is no ELF file.
pub fn functions(elf: &[u8]) -> Result<Vec<Function>, TraceError> {
    let file = object::File::parse(elf).map_err(|error| TraceError::Elf(error.to_string()))?;
    // Mapping symbols (ELF for the Arm architecture, section 5.5.5): data from `$d` to the next `$t`.
    let mut marks: Vec<(u64, bool)> = file
        .symbols()
        .filter_map(|symbol| {
            let kind = symbol.name().ok()?.split('.').next()?;
            matches!(kind, "$d" | "$t").then(|| (symbol.address(), kind == "$d"))
        })
        .collect();
    marks.sort_unstable();
    let is_data = |address: u64| {
        let after = marks.partition_point(|&(at, _)| at <= address);
        after.checked_sub(1).is_some_and(|last| marks[last].1)
    };
    let mut all: Vec<Function> = file
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .filter_map(|symbol| {
            let address = symbol.address() & !1;
            let section = file.section_by_index(symbol.section_index()?).ok()?;
            let code = section.data_range(address, symbol.size()).ok()??;
            let path = format!("{:#}", rustc_demangle::demangle(symbol.name().ok()?));
            // `<crate::Type>::method` as `crate::Type::method`, whichever the mangling.
            Some(decode(path.replace(['<', '>'], ""), address, code, is_data))
        })
        .collect();
    all.sort_by_key(|function| function.address);
    all.dedup_by_key(|function| function.address);
    Ok(all)
}

fn decode(name: String, address: u64, code: &[u8], is_data: impl Fn(u64) -> bool) -> Function {
    let mut function = Function {
        name,
        address,
        ..Function::default()
    };
    let (halves, _) = code.as_chunks();
    let halves: Vec<u16> = halves.iter().map(|&two| u16::from_le_bytes(two)).collect();
    let ends = address + 2 * halves.len() as u64;
    let mut at = 0;
    while at < halves.len() {
        let here = address + 2 * at as u64;
        if is_data(here) {
            at += 1;
            continue;
        }
        let second = halves.get(at + 1).copied().unwrap_or_default();
        function.instructions.push(Instruction {
            address: here,
            halfwords: [halves[at], second],
        });
        match flow(here, halves[at], second) {
            Flow::Return => function.returns.push(here),
            Flow::Jump(to) if !(address..ends).contains(&to) => {
                function.tail_calls.push((here, to));
            }
            _ => {}
        }
        at += halfwords(halves[at]);
    }
    function
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decode_skips_literals_and_finds_ends() {
        // push {lr}; a literal word; bl 0x100; b.w 0x1104; pop {pc}
        let code = [
            0xB500_u16, 0x4770, 0x4770, 0xF7FF, 0xFFFB, 0xF000, 0xBFF9, 0xBD00,
        ];
        let code: Vec<u8> = code.into_iter().flat_map(u16::to_le_bytes).collect();
        let function = decode("f".into(), 0x100, &code, |at| (0x102..0x106).contains(&at));
        let begins = function.instructions.iter().map(|one| one.address);
        assert!(begins.eq([0x100, 0x106, 0x10A, 0x10E]));
        assert_eq!(function.returns, [0x10E]);
        assert_eq!(function.tail_calls, [(0x10A, 0x1100)]);
    }
}

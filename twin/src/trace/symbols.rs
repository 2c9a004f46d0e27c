//! A function of the firmware: where it begins and where it returns.

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::thumb::{flow, halfwords, Flow};

/// Tail calls are followed this deep.
const DEPTH: usize = 6;

/// A function as its code shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    /// Its symbol.
    pub name: String,
    /// Its first instruction.
    pub address: u64,
    /// Its bytes.
    pub size: u64,
    /// The instructions it returns by.
    pub returns: Vec<u64>,
    /// The jumps out of it, and what they jump to.
    pub tail_calls: Vec<(u64, Function)>,
}

/// A function as a profile sees it: a range and its instructions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Code {
    /// Its symbol, or its type and method.
    pub name: String,
    /// Its first instruction.
    pub address: u64,
    /// Its bytes.
    pub size: u64,
    /// Where its instructions begin.
    pub instructions: Vec<u64>,
}

/// The function is not in the ELF file, or cannot be followed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoFunction(pub String);

impl std::fmt::Display for NoFunction {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "no function {} to follow", self.0)
    }
}

impl std::error::Error for NoFunction {}

impl Function {
    /// The function `name` of an ELF file: its symbol, or, where `name` is a path (`Type::method`),
    /// the first one whose mangled name contains the path.
    ///
    /// # Errors
    /// When there is none, or it has no code.
    pub fn find(elf: &[u8], name: &str) -> Result<Self, NoFunction> {
        let none = || NoFunction(name.to_owned());
        let file = object::File::parse(elf).map_err(|_| none())?;
        let functions = || {
            file.symbols()
                .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        };
        let path = mangled(name);
        let symbol = functions()
            .find(|symbol| symbol.name() == Ok(name))
            .or_else(|| functions().find(|s| s.name().is_ok_and(|found| found.contains(&path))))
            .ok_or_else(none)?;
        Self::at(&file, symbol.address() & !1, DEPTH).ok_or_else(none)
    }

    /// The jump out of the function at `address`, if one is there.
    #[must_use]
    pub fn tail_call(&self, address: u64) -> Option<&Self> {
        self.tail_calls
            .iter()
            .find(|(at, _)| *at == address)
            .map(|(_, callee)| callee)
    }

    /// Every instruction to watch, this function's and its tail calls'.
    #[must_use]
    pub fn watched(&self) -> Vec<u64> {
        let mut watched = vec![self.address];
        self.ends(&mut watched);
        watched.sort_unstable();
        watched.dedup();
        watched
    }

    fn ends(&self, into: &mut Vec<u64>) {
        into.extend(&self.returns);
        for (at, callee) in &self.tail_calls {
            into.push(*at);
            callee.ends(into);
        }
    }

    fn at(file: &object::File<'_>, address: u64, depth: usize) -> Option<Self> {
        let symbol = file.symbols().find(|symbol| {
            symbol.kind() == SymbolKind::Text
                && symbol.size() > 0
                && symbol.address() & !1 == address
        })?;
        let size = symbol.size();
        let section = file.section_by_index(symbol.section_index()?).ok()?;
        let code = section.data_range(address, size).ok()??;
        let halves: Vec<u16> = code
            .chunks_exact(2)
            .map(|half| u16::from_le_bytes([half[0], half[1]]))
            .collect();
        let mut function = Self {
            name: symbol.name().unwrap_or_default().to_owned(),
            address,
            size,
            returns: Vec::new(),
            tail_calls: Vec::new(),
        };
        let literals = literals(file, address, size);
        let mut at = address;
        while at < address + size {
            if literals.iter().any(|range| range.contains(&at)) {
                at += 2;
                continue;
            }
            let index = usize::try_from((at - address) / 2).ok()?;
            let first = *halves.get(index)?;
            let second = halves.get(index + 1).copied().unwrap_or_default();
            match flow(at, first, second) {
                Flow::Return => function.returns.push(at),
                Flow::Jump(to) if !(address..address + size).contains(&to) => {
                    if let Some(callee) = depth
                        .checked_sub(1)
                        .and_then(|depth| Self::at(file, to, depth))
                    {
                        function.tail_calls.push((at, callee));
                    }
                }
                _ => {}
            }
            at += 2 * halfwords(first);
        }
        Some(function)
    }
}

/// A path as both of the compiler's manglings write it: every part behind its length.
fn mangled(path: &str) -> String {
    let parts = path.split("::").map(|part| format!("{}{part}", part.len()));
    parts.collect()
}

/// The last two parts of the path in a mangled name: type and method; others as they are.
fn plain(symbol: &str) -> String {
    let Some(mut rest) = symbol.strip_prefix("_ZN") else {
        return symbol.to_owned();
    };
    let mut parts = Vec::new();
    while let Some(end) = rest.find(|c: char| !c.is_ascii_digit()) {
        let Ok(length) = rest[..end].parse::<usize>() else {
            break;
        };
        let Some(part) = rest.get(end..end + length) else {
            break;
        };
        parts.push(part);
        rest = &rest[end + length..];
    }
    // The last one is a hash.
    parts.pop();
    let from = parts.len().saturating_sub(2);
    parts[from..].join("::")
}

/// Every function of an ELF file, and where its instructions are.
///
/// # Errors
/// When it is no ELF file.
pub fn code(elf: &[u8]) -> Result<Vec<Code>, NoFunction> {
    let file = object::File::parse(elf).map_err(|error| NoFunction(error.to_string()))?;
    let mut all: Vec<Code> = file
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .filter_map(|symbol| {
            let (address, size) = (symbol.address() & !1, symbol.size());
            let section = file.section_by_index(symbol.section_index()?).ok()?;
            let bytes = section.data_range(address, size).ok()??;
            let literals = literals(&file, address, size);
            let mut instructions = Vec::new();
            let mut at = address;
            while at < address + size {
                if literals.iter().any(|range| range.contains(&at)) {
                    at += 2;
                    continue;
                }
                instructions.push(at);
                let from = usize::try_from(at - address).ok()?;
                let first = bytes.get(from..from + 2)?;
                at += 2 * halfwords(u16::from_le_bytes([first[0], first[1]]));
            }
            Some(Code {
                name: plain(symbol.name().ok()?),
                address,
                size,
                instructions,
            })
        })
        .collect();
    all.sort_by_key(|code| code.address);
    all.dedup_by_key(|code| code.address);
    Ok(all)
}

/// The ranges between `address` and its end that hold data: from a `$d` mapping symbol to the next
/// `$t` (ELF for the Arm architecture, section 5.5.5).
fn literals(file: &object::File<'_>, address: u64, size: u64) -> Vec<std::ops::Range<u64>> {
    let mut marks: Vec<(u64, bool)> = file
        .symbols()
        .filter_map(|symbol| {
            let name = symbol.name().ok()?;
            let data = name == "$d" || name.starts_with("$d.");
            let code = name == "$t" || name.starts_with("$t.");
            let at = symbol.address();
            ((data || code) && (address..address + size).contains(&at)).then_some((at, data))
        })
        .collect();
    marks.sort_unstable();
    let mut ranges = Vec::new();
    for (nth, &(at, data)) in marks.iter().enumerate() {
        if data {
            let end = marks.get(nth + 1).map_or(address + size, |&(next, _)| next);
            ranges.push(at..end);
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_mangled_and_shown_plain() {
        let symbol = "_ZN7fw_core6motion8odometry8Odometry4step17h89d3a8643620fae2E";
        assert!(symbol.contains(&mangled("Odometry::step")));
        assert_eq!(plain(symbol), "Odometry::step");
        assert_eq!(plain("robot_tick"), "robot_tick");
    }
}

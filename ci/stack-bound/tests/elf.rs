//! From an ELF file to its bound.

use object::write::{Object, Symbol, SymbolSection};
use object::{
    Architecture, BinaryFormat, Endianness, SectionKind, SymbolFlags, SymbolKind, SymbolScope,
};
use stack_bound::{Options, bound};

/// Vectors at 0, `main` behind them: push {r4, lr}; sub sp, #24; add sp, #24; pop {r4, pc}.
fn elf(symbols: &[(&str, u64)]) -> Vec<u8> {
    let mut object = Object::new(BinaryFormat::Elf, Architecture::Arm, Endianness::Little);
    let vectors = [0x2000_1000_u32, 0x9].map(u32::to_le_bytes).concat();
    let code = [0xB510_u16, 0xB086, 0xB006, 0xBD10]
        .map(u16::to_le_bytes)
        .concat();
    let section = object.add_section(Vec::new(), b".text".to_vec(), SectionKind::Text);
    object.append_section_data(section, &[vectors, code].concat(), 4);
    let mut add = |name: &str, value: u64, kind, section| {
        object.add_symbol(Symbol {
            name: name.into(),
            value,
            size: 0,
            kind,
            scope: SymbolScope::Linkage,
            weak: false,
            section,
            flags: SymbolFlags::None,
        });
    };
    add("main", 9, SymbolKind::Text, SymbolSection::Section(section));
    add("$d", 0, SymbolKind::Label, SymbolSection::Section(section));
    add("$t", 8, SymbolKind::Label, SymbolSection::Section(section));
    for &(name, value) in symbols {
        add(name, value, SymbolKind::Label, SymbolSection::Absolute);
    }
    object.write().unwrap()
}

#[test]
fn elf_with_symbols_has_a_bound() {
    let symbols = [
        ("__vector_table", 0),
        ("_stack_end", 0x2000_0000),
        ("_stack_start", 0x2000_1000),
    ];
    let report = bound(&elf(&symbols), &Options::default()).unwrap();
    assert_eq!(report.worst(), 32);
    assert_eq!(report.levels[0].chain, [("main".to_owned(), 32)]);
}

#[test]
fn elf_without_stack_symbols_is_refused() {
    let error = bound(&elf(&[]), &Options::default()).unwrap_err();
    assert!(error.to_string().contains("_stack_start"), "{error}");
    assert!(bound(b"text", &Options::default()).is_err());
}

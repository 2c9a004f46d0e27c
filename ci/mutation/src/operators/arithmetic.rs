//! Operators and what cargo-mutants puts in their places: it leaves out constructors.

use syn::BinOp;

const OTHERS: [(&str, &[&str]); 18] = [
    ("+", &["-", "*"]),
    ("-", &["+", "/"]),
    ("*", &["+", "/"]),
    ("/", &["%", "*"]),
    ("%", &["/", "+"]),
    ("<<", &[">>"]),
    (">>", &["<<"]),
    ("&", &["|", "^"]),
    ("|", &["&", "^"]),
    ("^", &["&", "|"]),
    ("&&", &["||"]),
    ("||", &["&&"]),
    ("==", &["!="]),
    ("!=", &["=="]),
    ("<", &["==", ">", "<="]),
    (">", &["==", "<", ">="]),
    ("<=", &[">"]),
    (">=", &["<"]),
];

/// An operator's text, and what may stand there instead.
pub(super) fn others(op: BinOp) -> (String, &'static [&'static str]) {
    let text = quote::quote!(#op).to_string();
    let known = OTHERS.iter().find(|(name, _)| *name == text);
    (text, known.map_or(&[], |(_, others)| *others))
}

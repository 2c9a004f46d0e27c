//! Whether the tests that cite a requirement notice a change of the code that cites it.
//!
//! A citation is a comment, `// Requirement: ONE, TWO`, above what meets the requirement or checks it. Above a
//! test, and everywhere in the packages whose tests are asked last, it checks.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::RangeInclusive;

use proc_macro2::TokenTree;
use quote::ToTokens;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

use crate::mutant::{Mutant, Span};

/// What stands below a citation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cited {
    /// Its lines, attributes left out.
    pub lines: RangeInclusive<usize>,
    /// The path of a function inside its crate: `wire::crc::tests::zeros`.
    pub function: Option<String>,
    /// It has the attribute `test`.
    pub is_test: bool,
}

/// Lines of a small function.
const SMALL: usize = 12;

/// Code that cites a requirement.
type Site = (String, RangeInclusive<usize>);

/// What cites a requirement.
#[derive(Debug, Default)]
pub struct Citations {
    /// Code: the file, from the workspace's root, and the lines.
    sites: BTreeMap<String, Vec<Site>>,
    /// The paths of tests, and whether they are in another package.
    checks: BTreeMap<String, BTreeSet<(String, bool)>>,
}

/// One test that cites a requirement, and the mutants of the code that does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    pub requirement: String,
    pub test: String,
    pub elsewhere: bool,
    pub mutants: Vec<usize>,
}

impl fmt::Display for Claim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (requirement, test, tried) = (&self.requirement, &self.test, self.mutants.len());
        write!(f, "{requirement}: {test} notices none of {tried} changes")
    }
}

impl Citations {
    /// Notes the citations of a file: `path` from the workspace's root, `module` its path in the crate.
    ///
    /// # Errors
    /// Where the text is no Rust.
    pub fn read(
        &mut self,
        (path, module): (&str, &[String]),
        text: &str,
        label: &str,
        elsewhere: bool,
    ) -> syn::Result<()> {
        for (ids, cited) in cited(text, module, label)? {
            for id in ids.split(',').map(|id| id.trim().to_owned()) {
                match &cited.function {
                    Some(check) if elsewhere || cited.is_test => {
                        let checks = self.checks.entry(id).or_default();
                        checks.insert((check.clone(), elsewhere));
                    }
                    _ if elsewhere => {}
                    _ => {
                        let sites = self.sites.entry(id).or_default();
                        sites.push((path.to_owned(), cited.lines.clone()));
                    }
                }
            }
        }
        Ok(())
    }

    /// Every test with every requirement that it cites, where the code that cites it has mutants. To replace all
    /// that a function of more than [`SMALL`] lines does is no change that a test shows its teeth with.
    pub fn claims(&self, all: &[Mutant], usable: impl Fn(usize) -> bool) -> Vec<Claim> {
        let inside = |mutant: &Mutant, (file, lines): &Site| {
            mutant.file == *file && lines.contains(&mutant.span.start.line)
        };
        let mut claims = Vec::new();
        for (requirement, sites) in &self.sites {
            let of_sites = all.iter().enumerate().filter(|(index, mutant)| {
                let Span { start, end } = mutant.span;
                let whole = mutant.genre == "FnValue" && end.line - start.line > SMALL;
                usable(*index) && !whole && sites.iter().any(|site| inside(mutant, site))
            });
            let mutants: Vec<_> = of_sites.map(|(index, _)| index).collect();
            for (test, elsewhere) in self.checks.get(requirement).into_iter().flatten() {
                if !mutants.is_empty() {
                    claims.push(Claim {
                        requirement: requirement.clone(),
                        test: test.clone(),
                        elsewhere: *elsewhere,
                        mutants: mutants.clone(),
                    });
                }
            }
        }
        claims
    }
}

/// The citations of a text, and what stands below each: the largest piece of syntax that begins first.
fn cited(text: &str, module: &[String], label: &str) -> syn::Result<Vec<(String, Cited)>> {
    let mark = format!("// {label}: ");
    let lines = (1..).zip(text.lines().map(str::trim));
    let wanted = lines.filter_map(|(number, line)| Some((number, line.strip_prefix(&mark)?)));
    let wanted: Vec<_> = wanted.collect();
    let mut finder = Finder {
        lines: wanted.iter().map(|(number, _)| *number).collect(),
        found: vec![None; wanted.len()],
        modules: module.to_vec(),
    };
    if !wanted.is_empty() {
        finder.visit_file(&syn::parse_file(text)?);
    }
    let found = wanted.into_iter().zip(finder.found);
    Ok(found
        .filter_map(|((_, ids), cited)| Some((ids.to_owned(), cited?)))
        .collect())
}

struct Finder {
    /// Of the citations.
    lines: Vec<usize>,
    found: Vec<Option<Cited>>,
    modules: Vec<String>,
}

impl Finder {
    fn consider(&mut self, node: &(impl ToTokens + Spanned), function: Option<&syn::ItemFn>) {
        let Some(start) = first_line(node) else {
            return;
        };
        let end = node.span().end().line;
        let path = |function: &syn::ItemFn| {
            let name = function.sig.ident.to_string();
            [&self.modules[..], &[name]].concat().join("::")
        };
        let mut attributes = function.iter().flat_map(|function| &function.attrs);
        let cited = Cited {
            lines: start..=end,
            function: function.map(path),
            is_test: attributes.any(|attribute| attribute.path().is_ident("test")),
        };
        for (line, found) in self.lines.iter().zip(&mut self.found) {
            let rank = |cited: &Cited| (*cited.lines.start(), usize::MAX - cited.lines.end());
            if start > *line
                && found
                    .as_ref()
                    .is_none_or(|known| rank(&cited) < rank(known))
            {
                *found = Some(cited.clone());
            }
        }
    }
}

/// The first line behind the attributes.
fn first_line(node: &impl ToTokens) -> Option<usize> {
    let mut tokens = node.to_token_stream().into_iter();
    loop {
        match tokens.next()? {
            TokenTree::Punct(mark) if mark.as_char() == '#' => {
                let _ = tokens.next();
            }
            token => return Some(token.span().start().line),
        }
    }
}

/// Visits of what is cited as it is, and of what is inside.
macro_rules! consider {
    ($($visit:ident: $node:ident),*) => {
        $(fn $visit(&mut self, node: &'ast syn::$node) {
            self.consider(node, None);
            visit::$visit(self, node);
        })*
    };
}

impl<'ast> Visit<'ast> for Finder {
    consider!(visit_impl_item: ImplItem, visit_stmt: Stmt, visit_arm: Arm);
    consider!(visit_field_value: FieldValue, visit_field: Field, visit_variant: Variant);

    fn visit_item(&mut self, item: &'ast syn::Item) {
        let function = match item {
            syn::Item::Fn(function) => Some(function),
            _ => None,
        };
        self.consider(item, function);
        visit::visit_item(self, item);
    }

    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        self.modules.push(module.ident.to_string());
        visit::visit_item_mod(self, module);
        self.modules.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutant::Position;

    const TEXT: &str = "\
impl A {
    /// Doc.
    // Cites: X-1, X-2
    #[inline]
    fn f(&self) -> u8 {
        // Cites: X-3
        let a = 1
            + 2;
        a
    }
}
#[cfg(test)]
mod tests {
    // Cites: X-1
    #[test]
    fn one() {}
    // Cites: X-9
    fn helper() {}
}
";

    #[test]
    fn citation_is_of_the_largest_piece_below_it() {
        let found = cited(TEXT, &["a".into()], "Cites").unwrap();
        let shown = found.into_iter().map(|(ids, cited)| {
            let name = cited.function.unwrap_or_default();
            format!("{ids} {:?} {name} {}", cited.lines, cited.is_test)
        });
        let expected = [
            "X-1, X-2 5..=10  false",
            "X-3 7..=8  false",
            "X-1 16..=16 a::tests::one true",
            "X-9 18..=18 a::tests::helper false",
        ];
        assert_eq!(shown.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn claim_has_the_mutants_of_its_requirements_code() {
        let mut citations = Citations::default();
        let file = "p/src/a.rs";
        let mut read = |place: (&str, &[String]), text: &str, elsewhere| {
            citations.read(place, text, "Cites", elsewhere).unwrap();
        };
        read((file, &["a".into()]), TEXT, false);
        let other = "// Cites: X-3\nfn q() {}\n";
        read(("q/src/lib.rs", &[]), other, true);
        let mutant = |line, genre: &str| Mutant {
            file: file.into(),
            genre: genre.into(),
            span: Span {
                start: Position { line, column: 1 },
                end: Position { line, column: 2 },
            },
            ..Mutant::default()
        };
        let mut whole = mutant(5, "FnValue");
        whole.span.end.line = 18;
        let [one, other, later] = [8, 8, 12].map(|line| mutant(line, "BinaryOperator"));
        let all = [whole, one, other, later];
        let claims = citations.claims(&all, |index| index != 2);
        let claim = |requirement: &str, test: &str, elsewhere| Claim {
            requirement: requirement.into(),
            test: test.into(),
            elsewhere,
            mutants: vec![1],
        };
        let expected = [
            claim("X-1", "a::tests::one", false),
            claim("X-3", "q", true),
        ];
        assert_eq!(claims, expected);
    }
}

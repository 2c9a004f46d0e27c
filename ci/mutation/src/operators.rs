//! Mutants beside those of cargo-mutants.
//!
//! A new operator lists its mutants here, under a genre of its own; [`crate::switch`] puts a
//! switch where it sees that genre, or leaves the mutant to a build of its own.

use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Expr, Stmt};

use crate::mutant::{Function, Mutant, Position, Span};

/// The genre of deleted statements.
pub const STATEMENT: &str = "Statement";

/// The names of the operators, for a configuration's `operators`.
pub const NAMES: [&str; 1] = ["delete-statement"];

/// Every assignment and call in these functions that stands as a statement, deleted.
///
/// # Errors
/// Where the text is no Rust.
pub fn delete_statements(
    file: &str,
    text: &str,
    functions: &[Function],
) -> syn::Result<Vec<Mutant>> {
    let mut statements = Statements(Vec::new());
    statements.visit_file(&syn::parse_file(text)?);
    let mutants = statements.0.into_iter().filter_map(|span| {
        let inside = |function: &&Function| {
            function.span.start <= span.start && span.end <= function.span.end
        };
        let function = functions.iter().rfind(inside)?;
        Some(Mutant {
            file: file.to_owned(),
            function: function.name.clone(),
            genre: STATEMENT.to_owned(),
            change: "delete statement".to_owned(),
            at: span.marked(text),
            span,
            replacement: String::new(),
        })
    });
    Ok(mutants.collect())
}

struct Statements(Vec<Span>);

impl<'ast> Visit<'ast> for Statements {
    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        if let Stmt::Expr(expression, Some(_)) = statement {
            let effect = match expression {
                Expr::Assign(_) | Expr::Call(_) | Expr::MethodCall(_) => true,
                Expr::Binary(binary) => !matches!(
                    binary.op,
                    BinOp::Eq(_) | BinOp::Ne(_) | BinOp::Lt(_) | BinOp::Gt(_)
                ),
                _ => false,
            };
            if effect {
                let position = |place: proc_macro2::LineColumn| Position {
                    line: place.line,
                    column: place.column + 1,
                };
                let span = statement.span();
                self.0.push(Span {
                    start: position(span.start()),
                    end: position(span.end()),
                });
            }
        }
        visit::visit_stmt(self, statement);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_with_effect_are_listed() {
        let text = "fn f() {\n    a = 1;\n    b += 2;\n    g(a);\n    let c = 3;\n    c\n}\nfn t() { h(); }\n";
        let functions = [Function {
            name: "f".into(),
            span: Span {
                start: Position { line: 1, column: 1 },
                end: Position { line: 7, column: 2 },
            },
        }];
        let mutants = delete_statements("a.rs", text, &functions).unwrap();
        let places: Vec<_> = mutants.iter().map(|mutant| &*mutant.at).collect();
        assert_eq!(places, ["«a = 1;»", "«b += 2;»", "«g(a);»"]);
        assert_eq!(mutants[2].to_string(), "a.rs:4:5: delete statement in f");
    }
}

//! Mutants beside those of cargo-mutants.
//!
//! A new operator lists its mutants here, under a genre of its own; [`crate::switch`] puts a
//! switch where it sees that genre, or leaves the mutant to a build of its own.

mod arithmetic;
mod places;

use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Expr, Lit, ReturnType, Stmt};

use crate::mutant::{Function, Mutant, Position, Span};
use places::{Places, assigns, calls, declares, moves};

/// A statement with an effect, deleted.
pub const STATEMENT: &str = "Statement";
/// A statement and the next one, swapped.
pub const SWAP: &str = "Swap";
/// An integer in a function, one more or one less.
pub const LITERAL: &str = "Literal";
/// An integer in a constant, one more or less; a large one doubled or halved.
pub const CONSTANT: &str = "Constant";
/// A method, by its opposite.
pub const METHOD: &str = "Method";
/// Methods and what stands in their place: what is kept in range wraps, one end is the other.
const OPPOSITES: [(&str, &str); 5] = [
    ("saturating_add", "wrapping_add"),
    ("saturating_sub", "wrapping_sub"),
    ("saturating_mul", "wrapping_mul"),
    ("min", "max"),
    ("max", "min"),
];

/// An operator of a constructor, as cargo-mutants changes those of other functions: of `new` it lists nothing.
pub const BINARY: &str = "BinaryOperator";

/// The names of the operators, for a configuration's `operators`, and their genres.
pub const NAMES: [(&str, &str); 6] = [
    ("constructors", BINARY),
    ("delete-statement", STATEMENT),
    ("swap-statements", SWAP),
    ("change-literal", LITERAL),
    ("change-constant", CONSTANT),
    ("change-method", METHOD),
];

/// Constants above this are doubled and halved: their next numbers are rarely another behaviour.
const LARGE: u128 = 1000;

/// The mutants of these genres in these functions, and in the constants beside them; with [`BINARY`] in
/// constructors too.
///
/// # Errors
/// Where the text is no Rust.
pub fn list(
    file: &str,
    text: &str,
    functions: &[Function],
    genres: &[&str],
) -> syn::Result<Vec<Mutant>> {
    let mut finder = Finder {
        text,
        genre: CONSTANT,
        ..Finder::default()
    };
    finder.visit_file(&syn::parse_file(text)?);
    let constructors = finder.constructors.iter();
    let constructors = constructors.filter(|_| genres.contains(&BINARY));
    let functions: Vec<_> = constructors.chain(functions).collect();
    let mutants = finder.mutants.into_iter();
    let mutants = mutants.filter(|mutant| genres.contains(&&*mutant.genre));
    let mutants = mutants.filter_map(|mutant| {
        let span = mutant.span;
        let inside = |function: &&Function| {
            function.span.start <= span.start && span.end <= function.span.end
        };
        let function = functions.iter().copied().rfind(inside);
        let constant = mutant.genre == CONSTANT;
        (constant || function.is_some()).then(|| Mutant {
            file: file.to_owned(),
            function: function.map_or_else(String::new, |function| function.name.clone()),
            at: span.marked(text),
            ..mutant
        })
    });
    Ok(mutants.collect())
}

#[derive(Default)]
struct Finder<'a> {
    text: &'a str,
    /// Of an integer here: in a constant, or in a function.
    genre: &'static str,
    /// The function returns nothing.
    unit: bool,
    /// What the functions here belong to.
    owner: String,
    /// In a constructor.
    constructing: bool,
    constructors: Vec<Function>,
    mutants: Vec<Mutant>,
}

fn position(place: proc_macro2::LineColumn) -> Position {
    Position {
        line: place.line,
        column: place.column + 1,
    }
}

fn span(node: &impl Spanned) -> Span {
    Span {
        start: position(node.span().start()),
        end: position(node.span().end()),
    }
}

impl Finder<'_> {
    fn add(&mut self, span: Span, genre: &str, change: String, replacement: String) {
        self.mutants.push(Mutant {
            genre: genre.to_owned(),
            change,
            span,
            replacement,
            ..Mutant::default()
        });
    }

    fn delete(&mut self, node: &impl Spanned, replacement: &str) {
        let change = "delete statement".to_owned();
        self.add(span(node), STATEMENT, change, replacement.to_owned());
    }

    fn swap(&mut self, one: &Stmt, other: &Stmt) {
        let text = |stmt| {
            let (from, to) = span(stmt).bytes(self.text);
            &self.text[from..to]
        };
        let both = Span {
            start: span(one).start,
            end: span(other).end,
        };
        let replacement = format!("{}\n{}", text(other), text(one));
        let change = "swap with the next statement".to_owned();
        self.add(both, SWAP, change, replacement);
    }

    fn function(&mut self, output: &ReturnType, visit: impl FnOnce(&mut Self)) {
        let outer = (self.genre, self.unit);
        (self.genre, self.unit) = (LITERAL, matches!(output, ReturnType::Default));
        visit(self);
        (self.genre, self.unit) = outer;
    }
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        let test = |attribute: &syn::Attribute| attribute.path().is_ident("cfg");
        if !module.attrs.iter().any(test) {
            visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig.output, |inner| inner.visit_block(&item.block));
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        let owner = &item.self_ty;
        self.owner = quote::quote!(#owner).to_string().replace(' ', "");
        visit::visit_item_impl(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.constructing = item.sig.ident == "new";
        if self.constructing {
            let (name, span) = (format!("{}::new", self.owner), span(item));
            self.constructors.push(Function { name, span });
        }
        self.function(&item.sig.output, |inner| inner.visit_block(&item.block));
        self.constructing = false;
    }

    fn visit_expr_binary(&mut self, binary: &'ast syn::ExprBinary) {
        if self.constructing {
            let (text, others) = arithmetic::others(binary.op);
            for other in others {
                let change = format!("replace {text} with {other}");
                self.add(span(&binary.op), BINARY, change, String::from(*other));
            }
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        if self.genre == CONSTANT {
            self.visit_expr(&item.expr);
        }
    }

    // Of traits: no place for a second one.
    fn visit_impl_item_const(&mut self, _: &'ast syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'ast syn::TraitItemConst) {}
    fn visit_item_static(&mut self, _: &'ast syn::ItemStatic) {}
    fn visit_item_enum(&mut self, _: &'ast syn::ItemEnum) {}
    fn visit_type(&mut self, _: &'ast syn::Type) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
    fn visit_generic_argument(&mut self, _: &'ast syn::GenericArgument) {}

    fn visit_expr_repeat(&mut self, expression: &'ast syn::ExprRepeat) {
        self.visit_expr(&expression.expr);
    }

    fn visit_expr_lit(&mut self, literal: &'ast syn::ExprLit) {
        let Lit::Int(integer) = &literal.lit else {
            return;
        };
        let Ok(value) = integer.base10_parse::<u128>() else {
            return;
        };
        let others = if value > LARGE {
            [Some(value * 2), Some(value / 2)]
        } else {
            [Some(value + 1), value.checked_sub(1)]
        };
        for other in others.into_iter().flatten() {
            let text = format!("{other}{}", integer.suffix());
            let change = format!("replace {integer} with {text}");
            self.add(span(literal), self.genre, change, text);
        }
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let method = &call.method;
        let known = OPPOSITES.iter().find(|(name, _)| method == name);
        if let Some((_, other)) = known.filter(|_| self.genre == LITERAL) {
            let change = format!("replace {method} with {other}");
            self.add(span(method), METHOD, change, String::from(*other));
        }
        visit::visit_expr_method_call(self, call);
    }

    fn visit_block(&mut self, block: &'ast syn::Block) {
        for pair in block.stmts.windows(2) {
            let [one, other] = pair else { continue };
            let moves = moves(other) || moves(one) && matches!(other, Stmt::Local(_));
            let stays = moves && !matches!(one, Stmt::Macro(_) | Stmt::Item(_));
            let places = [Places::of(one), Places::of(other)];
            let declared = declares(one, &places[1]) || declares(other, &places[0]);
            if stays && !declared && places[0].meet(&places[1]) {
                self.swap(one, other);
            }
        }
        visit::visit_block(self, block);
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        match statement {
            // Of one statement, that one is deleted inside.
            Stmt::Expr(Expr::If(branch), _)
                if branch.else_branch.is_none()
                    && (branch.then_branch.stmts.len() > 1
                        || !branch.then_branch.stmts.iter().all(moves)) =>
            {
                self.delete(statement, "");
            }
            Stmt::Expr(Expr::If(_), _) => {}
            Stmt::Expr(expression, end) => {
                let called = calls(expression) && (end.is_some() || self.unit);
                let looped = matches!(expression, Expr::ForLoop(_) | Expr::While(_));
                if assigns(expression) || called || looped {
                    self.delete(statement, "");
                }
                if let (Expr::Match(choice), true) = (expression, end.is_some() || self.unit) {
                    for arm in &choice.arms {
                        if calls(&arm.body) {
                            self.delete(&arm.body, "()");
                        }
                    }
                }
            }
            _ => {}
        }
        visit::visit_stmt(self, statement);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        if assigns(&arm.body) {
            self.delete(&arm.body, "()");
        }
        visit::visit_arm(self, arm);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The changed text of every mutant.
    fn changed(text: &str) -> Vec<String> {
        let end = Position {
            line: text.lines().count() + 1,
            column: 1,
        };
        let start = Position { line: 1, column: 1 };
        let functions = [Function {
            name: "f".into(),
            span: Span { start, end },
        }];
        let genres = NAMES.map(|(_, genre)| genre);
        let mutants = list("a.rs", text, &functions, &genres).unwrap();
        let changed = mutants.iter().map(|mutant| mutant.applied(text));
        changed.map(|text| text.replace('\n', " ")).collect()
    }

    #[test]
    fn statements_with_effect_are_deleted() {
        let deleted = changed("fn f() { a = b; if c { return; } let d = e; g(); }");
        assert_eq!(
            deleted,
            [
                "fn f() {  if c { return; } let d = e; g(); }",
                "fn f() { a = b;  let d = e; g(); }",
                "fn f() { a = b; if c { return; } let d = e;  }",
            ]
        );
        let deleted = changed("fn f() { match a { B => c = d, _ => e(), } }");
        assert_eq!(
            deleted,
            [
                "fn f() { match a { B => c = d, _ => (), } }",
                "fn f() { match a { B => (), _ => e(), } }",
            ]
        );
    }

    #[test]
    fn method_is_changed_to_its_opposite() {
        let changed = changed("fn f() -> u8 { a.min(b.saturating_sub(c)).g() }");
        let expected = [
            "fn f() -> u8 { a.max(b.saturating_sub(c)).g() }",
            "fn f() -> u8 { a.min(b.wrapping_sub(c)).g() }",
        ];
        assert_eq!(changed, expected);
    }

    #[test]
    fn arithmetic_of_constructors_is_changed() {
        let text = "impl A { fn new(b: u8) -> Self { A(b << 1) } fn f(self) -> u8 { self.0 + C } }";
        let expected =
            "impl A { fn new(b: u8) -> Self { A(b >> 1) } fn f(self) -> u8 { self.0 + C } }";
        assert!(changed(text).contains(&expected.to_owned()));
        let mutants = list("a.rs", text, &[], &[BINARY]).unwrap();
        let found = mutants.iter().map(|mutant| &*mutant.function);
        assert_eq!(found.collect::<Vec<_>>(), ["A::new"]);
    }

    #[test]
    fn dependent_statements_are_swapped() {
        let swapped = changed("fn f() { let a = self.b; self.b = c; self.d = c; }");
        assert_eq!(
            swapped[0],
            "fn f() { self.b = c; let a = self.b; self.d = c; }"
        );
        assert_eq!(swapped.len(), 3);
        let swapped = changed("fn f() { let a = b.c(); g(b, format!(\"{a}\")); }");
        assert!(!swapped.iter().any(|text| text.starts_with("fn f() { g(")));
    }

    #[test]
    fn integers_are_changed_but_not_in_tests() {
        assert_eq!(
            changed("const A: [u8; 2] = [3; 2]; #[cfg(test)] mod t { const B: u8 = 1; }"),
            [
                "const A: [u8; 2] = [4; 2]; #[cfg(test)] mod t { const B: u8 = 1; }",
                "const A: [u8; 2] = [2; 2]; #[cfg(test)] mod t { const B: u8 = 1; }",
            ]
        );
        assert_eq!(
            changed("fn f() -> u32 { 2000_u32 }"),
            ["fn f() -> u32 { 4000u32 }", "fn f() -> u32 { 1000u32 }"]
        );
    }
}

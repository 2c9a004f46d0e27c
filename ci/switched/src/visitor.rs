//! Finds what the mutants change and puts a switch there.

use std::collections::HashMap;

use proc_macro2::Span;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Block, Expr};

use crate::edits::Edits;

/// A mutant.
#[derive(Clone)]
pub struct Mutant {
    /// Its number in the list.
    pub number: usize,
    /// What kind of change it is.
    pub genre: String,
    /// What stands there instead.
    pub replacement: String,
}

/// Mutants by the line and column of what they change, both from 1.
pub type Mutants = HashMap<(usize, usize), Vec<Mutant>>;

/// Walks through a file.
pub struct Visitor<'a> {
    text: &'a str,
    mutants: &'a Mutants,
    /// Where each line starts.
    lines: Vec<usize>,
    /// Inside of something that the compiler calculates.
    constant: bool,
    /// The changes so far.
    pub edits: Edits,
    /// The numbers of the mutants that are in them.
    pub put_in: Vec<usize>,
}

impl<'a> Visitor<'a> {
    pub fn new(text: &'a str, mutants: &'a Mutants) -> Self {
        let ends = text.match_indices('\n').map(|(end, _)| end + 1);
        Self {
            text,
            mutants,
            lines: std::iter::once(0).chain(ends).collect(),
            constant: false,
            edits: Edits::default(),
            put_in: Vec::new(),
        }
    }

    /// The bytes of a span.
    fn range(&self, span: Span) -> (usize, usize) {
        let byte = |place: proc_macro2::LineColumn| {
            let start = self.lines[place.line - 1];
            let mut letters = self.text[start..].char_indices();
            let inside = letters.nth(place.column).map(|(inside, _)| inside);
            start + inside.unwrap_or(self.text.len() - start)
        };
        (byte(span.start()), byte(span.end()))
    }

    /// The mutants of a kind that change what starts here, from now on put in.
    fn take(&mut self, span: Span, genre: &str) -> Vec<Mutant> {
        let start = span.start();
        let here = self.mutants.get(&(start.line, start.column + 1));
        let here = here.filter(|_| !self.constant).into_iter().flatten();
        let taken: Vec<Mutant> = here
            .filter(|mutant| mutant.genre == genre)
            .cloned()
            .collect();
        self.put_in.extend(taken.iter().map(|mutant| mutant.number));
        taken
    }

    /// A function that returns something else at once.
    fn body(&mut self, block: &Block) {
        let Some(first) = block.stmts.first() else {
            return;
        };
        let (at, _) = self.range(first.span());
        for Mutant {
            number,
            replacement,
            ..
        } in self.take(first.span(), "FnValue")
        {
            self.edits.between(
                at,
                format!(
                    "if crate::mutant() == {number} {{ return {replacement}; }} /*~{number}*/\n"
                ),
            );
        }
    }

    fn constant(&mut self, visit: impl FnOnce(&mut Self)) {
        let outside = std::mem::replace(&mut self.constant, true);
        visit(self);
        self.constant = outside;
    }
}

fn marks(mutants: &[Mutant]) -> String {
    each(mutants, |mutant| format!("/*~{}*/", mutant.number))
}

fn each(mutants: &[Mutant], text: impl Fn(&Mutant) -> String) -> String {
    mutants.iter().map(text).collect::<Vec<_>>().concat()
}

/// The macro that switches an operator.
const fn kind(op: &BinOp) -> &'static str {
    use BinOp::{And, Eq, Ge, Gt, Le, Lt, Ne, Or};
    match op {
        Eq(_) | Ne(_) | Lt(_) | Le(_) | Gt(_) | Ge(_) => "mutant_comparison",
        And(_) | Or(_) => "mutant_logic",
        BinOp::Add(_)
        | BinOp::Sub(_)
        | BinOp::Mul(_)
        | BinOp::Div(_)
        | BinOp::Rem(_)
        | BinOp::BitXor(_)
        | BinOp::BitAnd(_)
        | BinOp::BitOr(_)
        | BinOp::Shl(_)
        | BinOp::Shr(_) => "mutant_operation",
        _ => "mutant_assignment",
    }
}

impl<'ast> Visit<'ast> for Visitor<'_> {
    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.constant(|visitor| visit::visit_item_const(visitor, item));
    }

    fn visit_item_static(&mut self, item: &'ast syn::ItemStatic) {
        self.constant(|visitor| visit::visit_item_static(visitor, item));
    }

    fn visit_impl_item_const(&mut self, item: &'ast syn::ImplItemConst) {
        self.constant(|visitor| visit::visit_impl_item_const(visitor, item));
    }

    fn visit_trait_item_const(&mut self, item: &'ast syn::TraitItemConst) {
        self.constant(|visitor| visit::visit_trait_item_const(visitor, item));
    }

    fn visit_expr_const(&mut self, expression: &'ast syn::ExprConst) {
        self.constant(|visitor| visit::visit_expr_const(visitor, expression));
    }

    // An array's length.
    fn visit_expr_repeat(&mut self, expression: &'ast syn::ExprRepeat) {
        self.visit_expr(&expression.expr);
    }

    fn visit_type(&mut self, _: &'ast syn::Type) {}

    fn visit_pat(&mut self, _: &'ast syn::Pat) {}

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.body(&item.block);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.body(&item.block);
        visit::visit_impl_item_fn(self, item);
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.body(block);
        }
        visit::visit_trait_item_fn(self, item);
    }

    fn visit_expr_binary(&mut self, expression: &'ast syn::ExprBinary) {
        let mutants = self.take(expression.op.span(), "BinaryOperator");
        if !mutants.is_empty() {
            let others: Vec<String> = mutants
                .iter()
                .map(|mutant| format!("{} {}", mutant.number, mutant.replacement))
                .collect();
            let (whole, op) = (
                self.range(expression.span()),
                self.range(expression.op.span()),
            );
            let name = kind(&expression.op);
            self.edits.around(whole, format!("crate::{name}!("), ")");
            let switch = format!(
                ", {} [{}] {},",
                &self.text[op.0..op.1],
                others.join(", "),
                marks(&mutants)
            );
            self.edits.instead(op, switch);
        }
        visit::visit_expr_binary(self, expression);
    }

    fn visit_expr_unary(&mut self, expression: &'ast syn::ExprUnary) {
        let mutants = self.take(expression.op.span(), "UnaryOperator");
        if let [Mutant { number, .. }] = mutants[..] {
            let (from, to) = self.range(expression.op.span());
            let op = &self.text[from..to];
            let switch = format!("crate::mutant_sign!({number}, {op}, /*~{number}*/");
            let whole = self.range(expression.span());
            self.edits.opened(whole, to - from, switch, ")");
        }
        visit::visit_expr_unary(self, expression);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        let deleted = self.take(arm.span(), "MatchArm");
        let mut condition = marks(&deleted);
        condition += &each(&deleted, |mutant| {
            format!("crate::mutant() != {} && ", mutant.number)
        });
        match &arm.guard {
            None if deleted.is_empty() => {}
            None => {
                let (_, end) = self.range(arm.pat.span());
                self.edits.between(end, format!(" if {condition}true "));
            }
            Some((_, guard)) => self.guard(guard, condition),
        }
        visit::visit_arm(self, arm);
    }
}

impl Visitor<'_> {
    fn guard(&mut self, guard: &Expr, mut condition: String) {
        let replaced = self.take(guard.span(), "MatchArmGuard");
        if condition.is_empty() && replaced.is_empty() {
            return;
        }
        condition += &marks(&replaced);
        condition += "match crate::mutant() { ";
        condition += &each(&replaced, |mutant| {
            format!("{} => {}, ", mutant.number, mutant.replacement)
        });
        condition += "_ => (";
        let (from, to) = self.range(guard.span());
        // The guard's own switch, if it has one, is inside.
        self.edits.outside((from, to), condition, ") }");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn switched(text: &str, mutants: &[((usize, usize), &str, &str)]) -> String {
        let mut by_place = Mutants::new();
        for (at, (place, genre, replacement)) in mutants.iter().enumerate() {
            by_place.entry(*place).or_default().push(Mutant {
                number: at + 1,
                genre: (*genre).into(),
                replacement: (*replacement).into(),
            });
        }
        let mut visitor = Visitor::new(text, &by_place);
        visitor.visit_file(&syn::parse_file(text).unwrap());
        visitor.edits.applied(text)
    }

    #[test]
    fn each_kind_of_change_has_its_switch() {
        let text = "fn f(a: u8) -> bool { a + 1 == 2 }";
        let mutants = [
            ((1, 23), "FnValue", "true"),
            ((1, 25), "BinaryOperator", "-"),
            ((1, 29), "BinaryOperator", "!="),
        ];
        assert_eq!(
            switched(text, &mutants),
            "fn f(a: u8) -> bool { if crate::mutant() == 1 { return true; } /*~1*/\n\
             crate::mutant_comparison!(crate::mutant_operation!(a , + [2 -] /*~2*/, 1) , \
             == [3 !=] /*~3*/, 2) }"
        );
        let text = "fn f(a: u8) -> i8 { match a { 1 => -1, 2 if a > 0 => 2, _ => 0 } }";
        let mutants = [
            ((1, 31), "MatchArm", ""),
            ((1, 36), "UnaryOperator", ""),
            ((1, 45), "MatchArmGuard", "false"),
        ];
        assert_eq!(
            switched(text, &mutants),
            "fn f(a: u8) -> i8 { match a { 1 if /*~1*/crate::mutant() != 1 && true  => \
             crate::mutant_sign!(2, -, /*~2*/1), 2 if /*~3*/match crate::mutant() { 3 => false, _ => \
             (a > 0) } => 2, _ => 0 } }"
        );
    }

    #[test]
    fn what_the_compiler_calculates_is_left_alone() {
        let text = "const A: u8 = 1 + 2; fn f() -> [u8; 1 + 2] { [0; 1 + 2] }";
        let places = [(1, 17), (1, 39), (1, 52)];
        let mutants = places.map(|place| (place, "BinaryOperator", "-"));
        assert_eq!(switched(text, &mutants), text);
    }
}

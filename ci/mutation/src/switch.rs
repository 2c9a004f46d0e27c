//! Rewrites a file so that the variable `MUTANT` of the built program switches one mutant on.
//!
//! Not switched, because the compiler evaluates them or has no place for a condition: constants that are
//! not private, types, patterns, fields, and what is inside macros.

mod constants;

use std::collections::HashMap;

use proc_macro2::{Literal, Span, TokenStream};
use quote::quote;
use syn::spanned::Spanned;
use syn::visit_mut::{self, VisitMut};
use syn::{Arm, BinOp, Block, Expr, Stmt, parse_quote};

use crate::mutant::Mutant;
use crate::operators::{LITERAL, METHOD, STATEMENT, SWAP};
pub use constants::Constants;
use constants::{Calls, function_of};

/// What the crate's root needs: which mutant is on, and the macros of the switches.
pub const SWITCH: &str = include_str!("switch.in.rs");

/// The compiler's features that [`SWITCH`] needs: a function that reads the environment at run
/// time and returns 0 where the compiler evaluates it.
pub const FEATURES: &str = "#![feature(core_intrinsics, const_eval_select)]\n";

/// How a mutant's number is written, so that a compiler's error can be traced to it.
const MARK: &str = "0_0_";

/// The numbers of the mutants in a rewritten line.
pub fn marked(line: &str) -> impl Iterator<Item = usize> + '_ {
    let numbers = line.split(MARK).skip(1);
    numbers.filter_map(|text| {
        let end = text.find(|letter: char| !letter.is_ascii_digit());
        text[..end.unwrap_or(text.len())].parse().ok()
    })
}

/// The text with a switch for each of these numbered mutants, and the numbers of those that it
/// has one for. `constants` are those with a function in the modules around; the file's own are
/// added.
///
/// # Errors
/// Where the text is no Rust.
pub fn switch(
    text: &str,
    mutants: &[(usize, &Mutant)],
    constants: &mut Constants,
) -> syn::Result<(String, Vec<usize>)> {
    let mut file = syn::parse_file(text)?;
    let mut by_start = HashMap::<_, Vec<_>>::new();
    for &(number, mutant) in mutants {
        let start = mutant.span.start;
        let here = by_start.entry((start.line, start.column)).or_default();
        here.push((number, mutant));
    }
    let mut rewriter = Rewriter {
        mutants: by_start,
        switched: Vec::new(),
        constants,
    };
    rewriter.constants(&mut file.items);
    rewriter.visit_file_mut(&mut file);
    Ok((prettyplease::unparse(&file), rewriter.switched))
}

struct Rewriter<'a> {
    /// By the line and column of what they change.
    mutants: HashMap<(usize, usize), Vec<(usize, &'a Mutant)>>,
    switched: Vec<usize>,
    constants: &'a mut Constants,
}

/// A mutant's number as it is written.
fn marked_literal(number: usize) -> Option<Literal> {
    format!("{MARK}{number}").parse().ok()
}

impl Rewriter<'_> {
    /// The numbers and replacements of the mutants of a genre that change what starts here; from
    /// now on they count as switched. To be called before anything inside is rewritten.
    fn take(&mut self, span: Span, genre: &str) -> (Vec<Literal>, Vec<TokenStream>) {
        let start = span.start();
        let here = self.mutants.get(&(start.line, start.column + 1));
        let here = here.into_iter().flatten();
        let taken: Vec<_> = here
            .filter(|(_, mutant)| mutant.genre == genre)
            .filter_map(|(number, mutant)| {
                self.switched.push(*number);
                Some((marked_literal(*number)?, mutant.replacement.parse().ok()?))
            })
            .collect();
        taken.into_iter().unzip()
    }

    /// The statements of a block, some with the next one moved before them or themselves behind it.
    fn statements(&mut self, block: &mut Block) {
        let pairs: Vec<_> = (block.stmts.iter())
            .map(|statement| self.take(statement.span(), SWAP).0.pop())
            .collect();
        visit_mut::visit_block_mut(self, block);
        let on = |number: &Literal, statement: &Stmt| -> Stmt {
            parse_quote!(if crate::active_mutant() == #number { #statement })
        };
        let stmts = std::mem::take(&mut block.stmts);
        for (index, statement) in stmts.iter().enumerate() {
            let before = index
                .checked_sub(1)
                .and_then(|before| pairs[before].as_ref());
            let next = pairs[index]
                .as_ref()
                .map(|number| (number, &stmts[index + 1]));
            let mut off = Vec::new();
            match next {
                // The next one declares: this one moves behind it.
                Some((number, Stmt::Local(_))) => off.push(number),
                Some((number, next)) => block.stmts.push(on(number, next)),
                None => {}
            }
            match (before, statement) {
                (Some(number), Stmt::Local(_)) => {
                    block.stmts.push(statement.clone());
                    block.stmts.push(on(number, &stmts[index - 1]));
                    continue;
                }
                (Some(number), _) => off.push(number),
                (None, _) => {}
            }
            block.stmts.push(if off.is_empty() {
                statement.clone()
            } else {
                parse_quote!(if true #(&& crate::active_mutant() != #off)* { #statement })
            });
        }
    }

    /// A function that returns another value at once.
    fn body(&mut self, block: &mut Block) {
        let Some(first) = block.stmts.first() else {
            return;
        };
        let (numbers, values) = self.take(first.span(), "FnValue");
        self.visit_block_mut(block);
        for (number, value) in numbers.iter().zip(values) {
            let early = parse_quote!(if crate::active_mutant() == #number { return #value; });
            block.stmts.insert(0, early);
        }
    }
}

/// The macro that switches an operator.
fn switch_of(op: &BinOp) -> TokenStream {
    match quote!(#op).to_string().as_str() {
        "==" | "!=" | "<" | "<=" | ">" | ">=" => quote!(mutant_comparison),
        "&&" | "||" => quote!(mutant_logic),
        assignment if assignment.ends_with('=') => quote!(mutant_assignment),
        _ => quote!(mutant_operation),
    }
}

impl VisitMut for Rewriter<'_> {
    fn visit_item_const_mut(&mut self, _: &mut syn::ItemConst) {}
    fn visit_item_static_mut(&mut self, _: &mut syn::ItemStatic) {}
    fn visit_impl_item_const_mut(&mut self, _: &mut syn::ImplItemConst) {}
    fn visit_trait_item_const_mut(&mut self, _: &mut syn::TraitItemConst) {}
    fn visit_expr_const_mut(&mut self, _: &mut syn::ExprConst) {}
    fn visit_type_mut(&mut self, _: &mut syn::Type) {}
    fn visit_pat_mut(&mut self, _: &mut syn::Pat) {}

    // Not the array's length.
    fn visit_expr_repeat_mut(&mut self, expression: &mut syn::ExprRepeat) {
        self.visit_expr_mut(&mut expression.expr);
    }

    fn visit_item_fn_mut(&mut self, item: &mut syn::ItemFn) {
        // Not what `constants` made.
        if !item.sig.ident.to_string().ends_with("_mutated") {
            self.body(&mut item.block);
        }
    }

    fn visit_impl_item_fn_mut(&mut self, item: &mut syn::ImplItemFn) {
        self.body(&mut item.block);
    }

    fn visit_trait_item_fn_mut(&mut self, item: &mut syn::TraitItemFn) {
        if let Some(block) = &mut item.default {
            self.body(block);
        }
    }

    fn visit_block_mut(&mut self, block: &mut Block) {
        self.statements(block);
    }

    fn visit_item_use_mut(&mut self, item: &mut syn::ItemUse) {
        if matches!(&item.tree, syn::UseTree::Path(path) if path.ident == "super") {
            visit_mut::visit_item_use_mut(self, item);
        }
    }

    // The test modules may import a constant by its name.
    fn visit_use_tree_mut(&mut self, tree: &mut syn::UseTree) {
        match tree {
            syn::UseTree::Name(name) if self.constants.contains_key(&name.ident.to_string()) => {
                let (name, of) = (&name.ident, function_of(&name.ident));
                *tree = parse_quote!({#name, #of});
            }
            _ => visit_mut::visit_use_tree_mut(self, tree),
        }
    }

    fn visit_stmt_mut(&mut self, statement: &mut Stmt) {
        let (numbers, _) = self.take(statement.span(), STATEMENT);
        visit_mut::visit_stmt_mut(self, statement);
        for number in numbers {
            *statement = parse_quote!(if crate::active_mutant() != #number { #statement });
        }
    }

    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        let (numbers, others) = match expression {
            Expr::Binary(binary) => self.take(binary.op.span(), "BinaryOperator"),
            Expr::Unary(unary) => self.take(unary.op.span(), "UnaryOperator"),
            Expr::Lit(literal) => self.take(literal.span(), LITERAL),
            Expr::MethodCall(call) => self.take(call.method.span(), METHOD),
            _ => (Vec::new(), Vec::new()),
        };
        visit_mut::visit_expr_mut(self, expression);
        match (&*expression, numbers.first()) {
            (Expr::Binary(binary), Some(_)) => {
                let syn::ExprBinary {
                    left, op, right, ..
                } = binary;
                let name = switch_of(op);
                *expression =
                    parse_quote!(crate::#name!(#left, #op [#(#numbers #others),*], #right));
            }
            (Expr::Unary(unary), Some(number)) => {
                let syn::ExprUnary { op, expr, .. } = unary;
                *expression = parse_quote!(crate::mutant_sign!(#number, #op, #expr));
            }
            (Expr::MethodCall(call), Some(number)) => {
                let syn::ExprMethodCall { receiver, args, .. } = call;
                let other = &others[0];
                *expression = parse_quote! {
                    (match crate::active_mutant() { #number => #receiver.#other(#args), _ => #call })
                };
            }
            (Expr::Lit(literal), Some(_)) => {
                *expression = parse_quote! {
                    (match crate::active_mutant() { #(#numbers => #others,)* _ => #literal })
                };
            }
            (Expr::Path(_), _) => Calls(self.constants, Vec::new()).visit_expr_mut(expression),
            _ => {}
        }
    }

    fn visit_arm_mut(&mut self, arm: &mut Arm) {
        let (deleted, _) = self.take(arm.span(), "MatchArm");
        let (effects, _) = match &*arm.body {
            Expr::Block(_) => Default::default(),
            body => self.take(body.span(), STATEMENT),
        };
        let guard = arm.guard.as_ref().map(|(_, guard)| guard.span());
        let guarded = guard.map(|span| self.take(span, "MatchArmGuard"));
        let (numbers, others) = guarded.unwrap_or_default();
        visit_mut::visit_arm_mut(self, arm);
        for number in effects {
            let body = &arm.body;
            arm.body = parse_quote!({ if crate::active_mutant() != #number { #body; } });
        }
        if deleted.is_empty() && numbers.is_empty() {
            return;
        }
        let guard = arm
            .guard
            .take()
            .map_or(parse_quote!(true), |(_, guard)| guard);
        let condition: Box<Expr> = parse_quote! {
            #(crate::active_mutant() != #deleted &&)*
            match crate::active_mutant() { #(#numbers => #others,)* _ => #guard }
        };
        arm.guard = Some((parse_quote!(if), condition));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutant::Position;
    use crate::operators::CONSTANT;

    /// The rewritten text without white space.
    fn switched(text: &str, mutants: &[(usize, &str, &str)]) -> String {
        let mutants = mutants.iter().map(|&(column, genre, replacement)| {
            let mut mutant = Mutant {
                genre: genre.into(),
                replacement: replacement.into(),
                ..Mutant::default()
            };
            mutant.span.start = Position { line: 1, column };
            mutant
        });
        let mutants: Vec<Mutant> = mutants.collect();
        let numbered: Vec<_> = (1..).zip(&mutants).collect();
        let text = switch(text, &numbered, &mut Constants::new()).unwrap().0;
        text.split_whitespace().collect()
    }

    #[test]
    fn every_genre_has_a_switch() {
        let text = "fn f(a: u8) -> bool { a + 1 == 2 }";
        let mutants = [
            (23, "FnValue", "true"),
            (25, "BinaryOperator", "-"),
            (29, "BinaryOperator", "!="),
        ];
        let compared =
            "crate::mutant_comparison!(crate::mutant_operation!(a,+[0_0_2-],1),==[0_0_3!=],2)";
        let early = "ifcrate::active_mutant()==0_0_1{returntrue;}";
        assert_eq!(
            switched(text, &mutants),
            format!("fnf(a:u8)->bool{{{early}{compared}}}")
        );
        let text = "fn f(a: u8) -> i8 { match a { 1 => -1, 2 if a > 0 => 2, _ => 0 } }";
        let mutants = [
            (31, "MatchArm", ""),
            (36, "UnaryOperator", ""),
            (45, "MatchArmGuard", "false"),
        ];
        let arms = [
            "1ifcrate::active_mutant()!=0_0_1&&matchcrate::active_mutant(){_=>true,}=>",
            "crate::mutant_sign!(0_0_2,-,1),",
            "2ifmatchcrate::active_mutant(){0_0_3=>false,_=>a>0,}=>2,_=>0,",
        ];
        let matched = arms.concat();
        assert_eq!(
            switched(text, &mutants),
            format!("fnf(a:u8)->i8{{matcha{{{matched}}}}}")
        );
        let deleted = switched("fn f() { g(); }", &[(10, STATEMENT, "")]);
        assert_eq!(deleted, "fnf(){ifcrate::active_mutant()!=0_0_1{g();}}");
        let swapped = switched("fn f() { g(); h(); }", &[(10, SWAP, "")]);
        let later = "iftrue&&crate::active_mutant()!=0_0_1{h();}";
        let earlier = "ifcrate::active_mutant()==0_0_1{h();}";
        assert_eq!(swapped, format!("fnf(){{{earlier}g();{later}}}"));
        let method = switched("fn f() -> u8 { a.min(b) }", &[(18, METHOD, "max")]);
        let chosen = "(matchcrate::active_mutant(){0_0_1=>a.max(b),_=>a.min(b),})";
        assert!(method.contains(chosen), "{method}");
        let literal = switched("fn f() -> u8 { 4 }", &[(16, LITERAL, "5")]);
        assert!(
            literal.contains("(matchcrate::active_mutant(){0_0_1=>5,_=>4,})"),
            "{literal}"
        );
        let text = "const A: u8 = 3; fn f() -> u8 { A }";
        let constant = switched(text, &[(15, CONSTANT, "4")]);
        let function = "constfnA_mutated(_:u32)->u8{matchcrate::active_mutant(){0_0_1=>4,_=>A,}}";
        assert!(constant.contains("{A_mutated(0_0_1)}"), "{constant}");
        assert!(constant.ends_with(function), "{constant}");
        let text = "const A: u8 = 3; const B: u8 = A; fn f() -> u8 { B }";
        let of_constant = switched(text, &[(15, CONSTANT, "4")]);
        let arms = "matchcrate::active_mutant(){0_0_1=>A_mutated(0_0_1),_=>B,}}";
        assert!(of_constant.ends_with(arms), "{of_constant}");
    }

    #[test]
    fn constants_have_no_switch() {
        let text = "const A: u8 = 1 + 2; fn f() -> [u8; 1 + 2] { [0; 1 + 2] }";
        let mutants = [17, 39, 52].map(|column| (column, "BinaryOperator", "-"));
        assert!(!switched(text, &mutants).contains("crate"));
    }

    #[test]
    fn mark_gives_the_number_back() {
        assert_eq!(
            marked("m!(a, + [0_0_12 -, 0_0_3 *], 0)").collect::<Vec<_>>(),
            [12, 3]
        );
    }
}

//! Private constants: beside each a function that switches its value, which its module and those inside call instead.

use std::collections::HashMap;

use proc_macro2::{Literal, TokenStream};
use quote::quote;
use syn::spanned::Spanned;
use syn::visit_mut::{self, VisitMut};
use syn::{Expr, Ident, Item, Visibility, parse_quote};

use super::{Rewriter, marked, marked_literal};
use crate::operators::CONSTANT;

/// A private constant's function: the constant's name, and the numbers of the mutants that change it.
pub type Constants = HashMap<String, Vec<usize>>;

/// The name of a constant's function.
pub(super) fn function_of(constant: &Ident) -> Ident {
    quote::format_ident!("{constant}_mutated")
}

/// Replaces the integers of a constant by others, or notes which mutants they have.
struct Integers<'a, 'b>(&'a mut Rewriter<'b>, Vec<(usize, Literal, TokenStream)>);

impl VisitMut for Integers<'_, '_> {
    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        if let Expr::Lit(literal) = expression {
            let (numbers, others) = self.0.take(literal.span(), CONSTANT);
            let place = literal.span().start();
            let place = place.line << 16 | place.column;
            let mutants = numbers.into_iter().zip(others);
            self.1
                .extend(mutants.map(|(number, other)| (place, number, other)));
        }
        visit_mut::visit_expr_mut(self, expression);
    }
}

/// Replaces what starts at one place.
struct Replace(usize, TokenStream);

impl VisitMut for Replace {
    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        let place = expression.span().start();
        if matches!(expression, Expr::Lit(_)) && place.line << 16 | place.column == self.0 {
            let other = &self.1;
            *expression = parse_quote!(#other);
        } else {
            visit_mut::visit_expr_mut(self, expression);
        }
    }
}

/// Has an expression call the constants' functions, and notes the mutants that change these.
pub(super) struct Calls<'a>(pub(super) &'a Constants, pub(super) Vec<usize>);

impl VisitMut for Calls<'_> {
    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        let name = match expression {
            Expr::Path(name) => name.path.get_ident(),
            _ => None,
        };
        let numbers = name.and_then(|name| self.0.get(&name.to_string()));
        if let (Some(name), Some(numbers)) = (name, numbers) {
            let (of, first) = (function_of(name), marked_literal(numbers[0]));
            *expression = parse_quote!(#of(#first));
            self.1.extend(numbers);
        } else {
            visit_mut::visit_expr_mut(self, expression);
        }
    }
}

impl Rewriter<'_> {
    /// A function for each private constant with mutants, or made of one before it with mutants; those with
    /// one of the same name from around are no longer theirs.
    pub(super) fn constants(&mut self, items: &mut Vec<Item>) {
        let mut functions = Vec::<Item>::new();
        for item in items.iter_mut() {
            let Item::Const(constant) = item else {
                continue;
            };
            self.constants.remove(&constant.ident.to_string());
            if !matches!(constant.vis, Visibility::Inherited) || constant.ident == "_" {
                continue;
            }
            let mut integers = Integers(self, Vec::new());
            integers.visit_expr_mut(&mut constant.expr);
            let mutants = integers.1;
            let mut calling = constant.expr.clone();
            let mut calls = Calls(self.constants, Vec::new());
            calls.visit_expr_mut(&mut calling);
            let inner: Vec<_> = calls
                .1
                .iter()
                .map(|&number| marked_literal(number))
                .collect();
            let own = mutants.iter();
            let own =
                own.flat_map(|(_, number, _)| marked(&number.to_string()).collect::<Vec<_>>());
            let numbers: Vec<usize> = own.chain(calls.1).collect();
            if numbers.is_empty() {
                continue;
            }
            self.constants.insert(constant.ident.to_string(), numbers);
            let arms = mutants.iter().map(|(place, number, other)| {
                let mut value = constant.expr.clone();
                Replace(*place, other.clone()).visit_expr_mut(&mut value);
                quote!(#number => #value)
            });
            let (name, of, ty) = (&constant.ident, function_of(&constant.ident), &constant.ty);
            functions.push(parse_quote! {
                const fn #of(_: u32) -> #ty {
                    match crate::active_mutant() { #(#arms,)* #(#inner => #calling,)* _ => #name }
                }
            });
        }
        items.extend(functions);
    }
}

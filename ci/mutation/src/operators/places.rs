//! Which places a statement names and which of them it writes, as far as its text tells.

use syn::visit::{self, Visit};
use syn::{BinOp, Expr, Stmt};

/// Whether this stands for its effect alone, wherever it is.
pub(super) fn assigns(expression: &Expr) -> bool {
    match expression {
        Expr::Assign(_) => true,
        Expr::Binary(binary) => is_assignment(binary.op),
        _ => false,
    }
}

fn is_assignment(op: BinOp) -> bool {
    let op = quote::quote!(#op).to_string();
    op.ends_with('=') && !["==", "!=", "<=", ">="].contains(&&*op)
}

/// Whether it is a call.
pub(super) fn calls(expression: &Expr) -> bool {
    matches!(expression, Expr::Call(_) | Expr::MethodCall(_))
}

/// Whether it can be moved: not what declares, returns or has a value.
pub(super) fn moves(statement: &Stmt) -> bool {
    match statement {
        Stmt::Expr(expression, Some(_)) => assigns(expression) || calls(expression),
        Stmt::Expr(Expr::If(branch), None) => branch.else_branch.is_none(),
        Stmt::Expr(Expr::ForLoop(_) | Expr::While(_), _) => true,
        _ => false,
    }
}

/// Whether it declares a variable that is named elsewhere.
pub(super) fn declares(statement: &Stmt, elsewhere: &Places) -> bool {
    let Stmt::Local(local) = statement else {
        return false;
    };
    let mut declared = Places::default();
    declared.visit_pat(&local.pat);
    let named =
        |(path, _): &(Vec<String>, bool)| elsewhere.0.iter().any(|(other, _)| other[0] == path[0]);
    declared.0.iter().any(named)
}

/// The places that a statement names, `self.a.b` by its parts, and which of them it may write.
#[derive(Default)]
pub(super) struct Places(Vec<(Vec<String>, bool)>);

impl Places {
    pub(super) fn of(statement: &Stmt) -> Self {
        let mut places = Self::default();
        places.visit_stmt(statement);
        places
    }

    /// Of a method of the whole `self` it is unknown what it writes.
    fn write(&mut self, expression: &Expr) {
        let place = path(expression).filter(|path| path[..] != ["self"]);
        self.0.extend(place.map(|path| (path, true)));
    }

    pub(super) fn meet(&self, other: &Self) -> bool {
        let pairs = (self.0.iter()).flat_map(|one| other.0.iter().map(move |two| (one, two)));
        let same = |one: &[String], two: &[String]| one.iter().zip(two).all(|(a, b)| a == b);
        let mut pairs = pairs.filter(|(one, two)| one.1 || two.1);
        pairs.any(|(one, two)| same(&one.0, &two.0))
    }
}

impl<'ast> Visit<'ast> for Places {
    fn visit_expr(&mut self, expression: &'ast Expr) {
        match expression {
            Expr::Assign(assign) => self.write(&assign.left),
            Expr::Binary(binary) if is_assignment(binary.op) => self.write(&binary.left),
            Expr::MethodCall(call) if !calculates(&call.method.to_string()) => {
                self.write(&call.receiver);
            }
            Expr::Reference(reference) if reference.mutability.is_some() => {
                self.write(&reference.expr);
            }
            _ => {}
        }
        match (path(expression), expression) {
            (None, _) => visit::visit_expr(self, expression),
            (Some(path), Expr::Index(index)) => {
                self.0.push((path, false));
                self.visit_expr(&index.index);
            }
            (Some(path), _) => self.0.push((path, false)),
        }
    }

    /// By its text, a format string's names among it.
    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        let text = call.tokens.to_string();
        let words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
        (self.0).extend(words.map(|word| (vec![word.to_owned()], false)));
    }

    fn visit_pat_ident(&mut self, name: &'ast syn::PatIdent) {
        self.0.push((vec![name.ident.to_string()], true));
    }
}

/// Methods of numbers: they change nothing.
fn calculates(method: &str) -> bool {
    let prefixes = [
        "wrapping_",
        "saturating_",
        "checked_",
        "unsigned_",
        "to_",
        "is_",
    ];
    ["abs", "clamp", "into", "max", "min"].contains(&method)
        || prefixes.iter().any(|prefix| method.starts_with(prefix))
}

/// The parts of `a.b.c`; what is computed has none.
fn path(expression: &Expr) -> Option<Vec<String>> {
    match expression {
        Expr::Path(name) => Some(vec![name.path.get_ident()?.to_string()]),
        Expr::Field(field) => {
            let mut path = path(&field.base)?;
            let member = &field.member;
            path.push(quote::quote!(#member).to_string());
            Some(path)
        }
        Expr::Index(index) => path(&index.expr),
        Expr::Paren(inner) => path(&inner.expr),
        _ => None,
    }
}

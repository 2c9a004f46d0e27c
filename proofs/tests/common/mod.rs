//! What explicit-state searches share besides `proofs::search`.
#![allow(dead_code, reason = "not every search needs all of it")]

use std::fmt::{self, Debug};
use std::hash::{Hash, Hasher};

/// A state that is known by a text, for code whose parts are private and not comparable: a derived debug text
/// shows every field.
#[derive(Clone)]
pub struct ByText<T> {
    pub value: T,
    pub text: String,
}

impl<T> PartialEq for ByText<T> {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

impl<T> Eq for ByText<T> {}

impl<T> Hash for ByText<T> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.text.hash(state);
    }
}

impl<T> Debug for ByText<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A debug text with each number replaced that follows a name and a blank, or a bracket.
pub fn with_numbers(text: &str, replaced: impl Fn(&str, u32) -> u32) -> String {
    let (mut name, mut shown) = ("", String::new());
    for token in text.split_inclusive([' ', '(']) {
        let rest = token.trim_start_matches(|c: char| c.is_ascii_digit());
        match token[..token.len() - rest.len()].parse() {
            Ok(number) => shown.extend([&replaced(name, number).to_string(), rest]),
            Err(_) => shown += token,
        }
        name = token;
    }
    shown
}

//! What explicit-state searches share besides `proofs::search`.

use std::fmt::{self, Debug};
use std::hash::{Hash, Hasher};

/// A state that is known by its debug text, for code whose parts are private and not comparable: a derived
/// text shows every field.
#[derive(Clone)]
pub struct ByText<T> {
    pub value: T,
    text: String,
}

impl<T: Debug> From<T> for ByText<T> {
    fn from(value: T) -> Self {
        let text = format!("{value:?}");
        Self { value, text }
    }
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

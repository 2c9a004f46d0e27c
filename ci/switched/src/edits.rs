//! Changes of a text, each at its place in the original.

/// How changes at the same place follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    /// Ends what begins further left: the shortest first.
    Close(usize),
    /// Stands between two pieces.
    Between,
    /// Begins a piece of so many bytes: the longest first.
    Open(std::cmp::Reverse<usize>),
    /// Stands for what is there.
    Instead,
}

/// The changes of one file.
#[derive(Default)]
pub struct Edits(Vec<(usize, Rank, usize, String)>);

impl Edits {
    /// Puts text before and after a piece, outside of what was or will be put around parts of it.
    pub fn around(&mut self, (from, to): (usize, usize), before: String, after: &str) {
        self.opened((from, to), 0, before, after);
    }

    /// As [`Self::around`], with so many of the piece's first bytes left out.
    pub fn opened(
        &mut self,
        (from, to): (usize, usize),
        without: usize,
        before: String,
        after: &str,
    ) {
        let length = to - from;
        let open = Rank::Open(std::cmp::Reverse(length));
        self.0.push((from, open, without, before));
        self.0.push((to, Rank::Close(length), 0, after.to_owned()));
    }

    /// As [`Self::around`], outside of what else is put around this very piece.
    pub fn outside(&mut self, (from, to): (usize, usize), before: String, after: &str) {
        let length = to - from + 1;
        let open = Rank::Open(std::cmp::Reverse(length));
        self.0.push((from, open, 0, before));
        self.0.push((to, Rank::Close(length), 0, after.to_owned()));
    }

    /// Puts text between two pieces.
    pub fn between(&mut self, at: usize, text: String) {
        self.0.push((at, Rank::Between, 0, text));
    }

    /// Puts text in a piece's stead.
    pub fn instead(&mut self, (from, to): (usize, usize), text: String) {
        self.0.push((from, Rank::Instead, to - from, text));
    }

    /// The text with all changes.
    pub fn applied(mut self, text: &str) -> String {
        self.0.sort_by_key(|(at, rank, ..)| (*at, *rank));
        let mut changed = String::new();
        let mut done = 0;
        for (at, _, without, put) in self.0 {
            changed += text.get(done..at).unwrap_or_default();
            changed += &put;
            done = done.max(at + without);
        }
        changed + &text[done..]
    }
}

#[cfg(test)]
mod tests {
    use super::Edits;

    #[test]
    fn what_is_put_around_a_piece_encloses_what_is_put_around_its_parts() {
        let text = "a + b + c";
        let mut edits = Edits::default();
        edits.around((0, 9), "[".into(), "]");
        edits.instead((6, 7), ",".into());
        edits.around((0, 5), "(".into(), ")");
        edits.instead((2, 3), ";".into());
        edits.between(0, "{".into());
        assert_eq!(edits.applied(text), "{[(a ; b) , c]");
        let mut edits = Edits::default();
        edits.opened((0, 2), 1, "not(".into(), ")");
        assert_eq!(edits.applied("!a"), "not(a)");
    }
}

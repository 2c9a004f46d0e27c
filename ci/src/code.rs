//! Rust source as a gate reads it: without comments, texts and characters.

/// The code with every comment, string and character blanked out; line breaks stay, so that a
/// position keeps its line.
pub fn bare(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    let mut rest = source;
    let mut word_before = false;
    while let Some(first) = rest.chars().next() {
        let skip = skipped(rest, word_before);
        if skip == 0 {
            out.push(first);
            word_before = first.is_alphanumeric() || first == '_';
            rest = &rest[first.len_utf8()..];
        } else {
            let (gone, left) = rest.split_at(skip);
            out.push(' ');
            out.extend(gone.chars().filter(|&letter| letter == '\n'));
            word_before = false;
            rest = left;
        }
    }
    out
}

/// Bytes of a comment, string or character that starts here; 0 where none does.
fn skipped(rest: &str, word_before: bool) -> usize {
    if rest.starts_with("//") {
        return rest.find('\n').unwrap_or(rest.len());
    }
    if rest.starts_with("/*") {
        return block_comment(rest);
    }
    if let Some(text) = rest.strip_prefix('"') {
        return 1 + quoted(text, '"');
    }
    if rest.starts_with('\'') {
        return character(rest);
    }
    if word_before {
        return 0;
    }
    let prefix = ["br", "cr", "r"].into_iter().find(|prefix| {
        rest.strip_prefix(prefix)
            .is_some_and(|tail| tail.trim_start_matches('#').starts_with('"'))
    });
    prefix.map_or(0, |prefix| raw(rest, prefix.len()))
}

fn block_comment(rest: &str) -> usize {
    let (mut depth, mut at) = (0_u32, 0);
    while at < rest.len() {
        let tail = &rest.as_bytes()[at..];
        if tail.starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if tail.starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    rest.len()
}

/// Bytes up to and with the closing `quote`.
fn quoted(rest: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, letter) in rest.char_indices() {
        if escaped {
            escaped = false;
        } else if letter == '\\' {
            escaped = true;
        } else if letter == quote {
            return at + 1;
        }
    }
    rest.len()
}

/// A character literal; 0 for a lifetime or a label.
fn character(rest: &str) -> usize {
    let mut letters = rest[1..].chars();
    match (letters.next(), letters.next()) {
        (Some('\\'), _) => 1 + quoted(&rest[1..], '\''),
        (Some(letter), Some('\'')) => 2 + letter.len_utf8(),
        _ => 0,
    }
}

fn raw(rest: &str, prefix: usize) -> usize {
    let tail = &rest[prefix..];
    let hashes = tail.len() - tail.trim_start_matches('#').len();
    let close = format!("\"{}", "#".repeat(hashes));
    let body = prefix + hashes + 1;
    rest[body..]
        .find(&close)
        .map_or(rest.len(), |at| body + at + close.len())
}

/// The line numbers, from 1, on which `word` stands as a word of its own.
pub fn lines_with(bare: &str, word: &str) -> Vec<usize> {
    let of_words = |letter: char| letter.is_alphanumeric() || letter == '_';
    let has = |line: &str| {
        line.split(|letter| !of_words(letter))
            .any(|found| found == word)
    };
    bare.lines()
        .enumerate()
        .filter(|(_, line)| has(line))
        .map(|(at, _)| at + 1)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_code_is_left() {
        let source = r##"
fn a<'x>(s: &'x str) { // unsafe
    let t = "unsafe \" unsafe"; /* unsafe /* unsafe */ unsafe */
    let r = r#"unsafe " unsafe"#; let c = '"'; let q = '\''; let u = 'ü'; let b = b"unsafe";
    unsafe { work() }
    let for_r = 1;
}
"##;
        let bare = bare(source);
        assert_eq!(lines_with(&bare, "unsafe"), [5], "{bare}");
        assert_eq!(bare.lines().count(), source.lines().count());
        assert!(bare.contains("for_r"));
    }

    #[test]
    fn words_are_whole() {
        assert!(lines_with("unsafe_code not_unsafe", "unsafe").is_empty());
    }
}

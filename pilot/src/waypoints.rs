//! Way-point files: one `x y deg` a line, millimetres and degrees, `#` begins a comment.

use host_link::error::Error;
use host_link::file::{self, FileFault};
use host_link::pose::{MAX_COORDINATE_MM, Pose};
use std::ops::Range;
use std::path::Path;

/// Largest rotation accepted, degrees.
pub const MAX_ROTATION_DEG: f64 = 36_000.0;

/// Most faults of a file that are shown.
const MAX_FAULTS: usize = 20;

/// Reads a way-point file.
///
/// # Errors
/// [`Error::Unreadable`]; [`Error::Content`] names the lines.
pub fn load(path: &Path) -> Result<Vec<Pose>, Error> {
    parse(&file::read_text(path)?).map_err(|faults| Error::Content {
        path: path.into(),
        faults,
    })
}

/// # Errors
/// What is wrong, line by line.
pub fn parse(text: &str) -> Result<Vec<Pose>, Vec<FileFault>> {
    let (mut waypoints, mut faults) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let content = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = content.split_whitespace().collect();
        match words.as_slice() {
            [] => {}
            [x, y, rotation] => match parse_pose(x, y, rotation) {
                Ok(pose) => waypoints.push(pose),
                Err((index, what)) => {
                    faults.push(FileFault::at(text, span(text, words[index]), what));
                }
            },
            _ => {
                let what = format!(
                    "a way-point is x, y and rotation, in millimetres and degrees: this line has {} of three",
                    words.len()
                );
                faults.push(FileFault::at(text, span(text, content.trim_end()), what));
            }
        }
        if faults.len() >= MAX_FAULTS {
            break;
        }
    }
    if faults.is_empty() && waypoints.is_empty() {
        let what = "no way-point: each line is `x y rotation`, in millimetres and degrees";
        faults.push(FileFault::whole(what));
    }
    if faults.is_empty() {
        return Ok(waypoints);
    }
    Err(faults)
}

/// Where in `text` this part of it is, bytes.
fn span(text: &str, part: &str) -> Range<usize> {
    let from = part.as_ptr().addr() - text.as_ptr().addr();
    from..from + part.len()
}

/// A pose from three words.
///
/// # Errors
/// The index of the word to blame; the word and the accepted range.
pub fn parse_pose(x: &str, y: &str, rotation: &str) -> Result<Pose, (usize, String)> {
    let number = |index, field: &str, word: &str, limit: f64, unit: &str| match word.parse() {
        // NaN is in no range.
        Ok(value) if (-limit..=limit).contains(&value) => Ok(value),
        _ => Err((
            index,
            format!("{field} = {word}: accepted is a number from -{limit} to {limit} {unit}"),
        )),
    };
    Ok(Pose::new(
        number(0, "x", x, MAX_COORDINATE_MM, "mm")?,
        number(1, "y", y, MAX_COORDINATE_MM, "mm")?,
        number(2, "rotation", rotation, MAX_ROTATION_DEG, "degrees")?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waypoints_skip_comments_and_blank_lines() {
        let waypoints = parse("# tour\n\n100 -20.5 90 # first\n0 0 0\n").unwrap();
        assert_eq!(waypoints.len(), 2);
        assert_eq!(waypoints[0], Pose::new(100.0, -20.5, 90.0));
    }

    #[test]
    fn waypoints_errors_name_lines_and_words() {
        let faults = parse("0 0 0\n1 2\n\n1 nan 2 # ç\ninf 0 0").unwrap_err();
        let lines: Vec<_> = faults.iter().map(|fault| fault.line).collect();
        assert_eq!(lines, [Some(2), Some(4), Some(5)]);
        let columns = faults.iter().map(|fault| fault.shown.clone().unwrap().1);
        assert_eq!(columns.collect::<Vec<_>>(), [0..3, 2..5, 0..3]);
        assert_eq!(parse("# nothing\n").unwrap_err()[0].line, None);
        assert_eq!(parse(&"x\n".repeat(1000)).unwrap_err().len(), MAX_FAULTS);
    }
}

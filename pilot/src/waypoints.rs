//! Way-point files: one `x y deg` a line, millimetres and degrees, `#` begins a comment.

use host_link::error::Error;
use host_link::pose::{MAX_COORDINATE_MM, Pose};
use std::fs;
use std::path::Path;

/// Largest rotation accepted, degrees.
pub const MAX_ROTATION_DEG: f64 = 36_000.0;

/// Reads a way-point file.
///
/// # Errors
/// [`Error::Unreadable`]; [`Error::Content`] names the line.
pub fn load(path: &Path) -> Result<Vec<Pose>, Error> {
    let text = fs::read_to_string(path).map_err(|cause| Error::unreadable(path, &cause))?;
    parse(&text).map_err(|(line, what)| Error::content(path, line, what))
}

/// # Errors
/// The 1-based line, if one is to blame, and what is wrong.
pub fn parse(text: &str) -> Result<Vec<Pose>, (Option<usize>, String)> {
    let mut waypoints = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let content = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = content.split_whitespace().collect();
        match words.as_slice() {
            [] => {}
            [x, y, rotation] => {
                waypoints.push(parse_pose(x, y, rotation).map_err(|what| (Some(number), what))?);
            }
            _ => {
                let what = format!(
                    "{} values where a way-point has three: x y rotation, in millimetres and degrees",
                    words.len()
                );
                return Err((Some(number), what));
            }
        }
    }
    if waypoints.is_empty() {
        return Err((
            None,
            "no way-point: each line is `x y rotation`, in millimetres and degrees".into(),
        ));
    }
    Ok(waypoints)
}

/// A pose from three words.
///
/// # Errors
/// Names the word and the accepted range.
pub fn parse_pose(x: &str, y: &str, rotation: &str) -> Result<Pose, String> {
    Ok(Pose::new(
        number("x", x, MAX_COORDINATE_MM, "mm")?,
        number("y", y, MAX_COORDINATE_MM, "mm")?,
        number("rotation", rotation, MAX_ROTATION_DEG, "degrees")?,
    ))
}

fn number(field: &str, word: &str, limit: f64, unit: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        // NaN is in no range.
        Ok(value) if (-limit..=limit).contains(&value) => Ok(value),
        _ => Err(format!(
            "{field} = {word}: accepted is a number from -{limit} to {limit} {unit}"
        )),
    }
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
    fn waypoints_error_names_line() {
        assert_eq!(parse("0 0 0\n1 2\n").unwrap_err().0, Some(2));
        assert_eq!(parse("0 0 0\n\n1 nan 2\n").unwrap_err().0, Some(3));
        assert_eq!(parse("inf 0 0").unwrap_err().0, Some(1));
        assert_eq!(parse("# nothing\n").unwrap_err().0, None);
    }
}

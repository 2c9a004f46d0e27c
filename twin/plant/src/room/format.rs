//! Rooms as text: one thing per line, `#` starts a comment, lengths in millimetres, angles in
//! degrees.
//!
//! ```text
//! wall x1 y1 x2 y2 [x3 y3 …]      a wall, or a line of walls through more points
//! box x y width depth [angle]     furniture, by its centre
//! circle x y radius               a pillar
//! start x y angle                 where the robot is put down (once; 0 0 0 if missing)
//! way x y angle                   the next way-point of the tour
//! ```

use super::Room;
use crate::Pose;
use std::fmt;

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// The first word is none of the format's.
    UnknownWord(String),
    /// A word that should be a finite number is none.
    NotANumber(String),
    /// The wrong count of numbers follows the first word: what is expected, what came.
    Count(&'static str, usize),
    /// A width, depth or radius that is not positive, or a wall of no length.
    Size(&'static str),
    /// A second `start`.
    SecondStart,
}

/// A room file's first error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParseError {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub problem: Problem,
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: ", self.line)?;
        match &self.problem {
            Problem::UnknownWord(word) => write!(
                f,
                "`{word}` begins no line of a room: use wall, box, circle, start or way, and # for a comment"
            ),
            Problem::NotANumber(word) => {
                write!(f, "`{word}` is not a finite number: write millimetres or degrees, like 1200 or -37.5")
            }
            Problem::Count(expected, got) => write!(f, "{got} numbers: write `{expected}`"),
            Problem::Size(what) => write!(f, "{what}: make it greater than zero"),
            Problem::SecondStart => write!(f, "a second start: keep one of them"),
        }
    }
}

impl std::error::Error for ParseError {}

impl Room {
    /// Reads a room from its text.
    ///
    /// # Errors
    /// The first line that is no room's, with what to do about it.
    pub fn parse(text: &str) -> Result<Self, ParseError> {
        let mut room = Self::default();
        let mut started = false;
        for (index, line) in text.lines().enumerate() {
            let content = line.split('#').next().unwrap_or_default();
            let mut words = content.split_whitespace();
            if let Some(word) = words.next() {
                let numbers = words.map(number).collect::<Result<Vec<f64>, Problem>>();
                room = numbers
                    .and_then(|numbers| room.with_line(word, &numbers, &mut started))
                    .map_err(|problem| ParseError {
                        line: index + 1,
                        problem,
                    })?;
            }
        }
        Ok(room)
    }

    fn with_line(
        mut self,
        word: &str,
        numbers: &[f64],
        started: &mut bool,
    ) -> Result<Self, Problem> {
        let count = |expected| Problem::Count(expected, numbers.len());
        match word {
            "wall" => {
                if numbers.len() < 4 || !numbers.len().is_multiple_of(2) {
                    return Err(count("wall x1 y1 x2 y2, then x y of each further point"));
                }
                let points: Vec<(f64, f64)> = numbers.chunks(2).map(|p| (p[0], p[1])).collect();
                for ends in points.windows(2) {
                    let ((x1, y1), (x2, y2)) = (ends[0], ends[1]);
                    if (x2 - x1).hypot(y2 - y1) <= 0.0 {
                        return Err(Problem::Size("a wall's length"));
                    }
                    self = self.with_wall(x1, y1, x2, y2);
                }
                Ok(self)
            }
            "box" => {
                let (x, y, width, depth, angle) = match *numbers {
                    [x, y, width, depth] => (x, y, width, depth, 0.0),
                    [x, y, width, depth, angle] => (x, y, width, depth, angle.to_radians()),
                    _ => return Err(count("box x y width depth, then its angle if turned")),
                };
                if width <= 0.0 || depth <= 0.0 {
                    return Err(Problem::Size("a box's width or depth"));
                }
                Ok(self.with_box(x, y, width, depth, angle))
            }
            "circle" => match *numbers {
                [_, _, radius] if radius <= 0.0 => Err(Problem::Size("a circle's radius")),
                [x, y, radius] => Ok(self.with_circle(x, y, radius)),
                _ => Err(count("circle x y radius")),
            },
            "start" => {
                if std::mem::replace(started, true) {
                    return Err(Problem::SecondStart);
                }
                self.start = pose(numbers).ok_or_else(|| count("start x y angle"))?;
                Ok(self)
            }
            "way" => {
                self.tour
                    .push(pose(numbers).ok_or_else(|| count("way x y angle"))?);
                Ok(self)
            }
            other => Err(Problem::UnknownWord(other.to_owned())),
        }
    }
}

fn number(word: &str) -> Result<f64, Problem> {
    match word.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(Problem::NotANumber(word.to_owned())),
    }
}

fn pose(numbers: &[f64]) -> Option<Pose> {
    match *numbers {
        [x, y, angle] => Some(Pose::new(x, y, angle.to_radians())),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Circle, Segment};
    use super::*;

    #[test]
    fn every_kind_of_line_is_read() {
        let room = Room::parse(
            "# a room\nwall 0 0 100 0 100 50\nbox 10 20 4 2 90 # turned\n\ncircle 1 2 3\nstart 1 2 180\nway 5 6 -90\nway 7 8 0\n",
        )
        .unwrap();
        assert_eq!(room.segments.len(), 6);
        assert_eq!(room.segments[1], Segment::new(100.0, 0.0, 100.0, 50.0));
        assert!(room.segments[2..]
            .iter()
            .any(|s| (s.x1 - 11.0).abs() < 1e-9));
        assert_eq!(
            room.circles,
            [Circle {
                x: 1.0,
                y: 2.0,
                radius: 3.0
            }]
        );
        assert_eq!(room.start, Pose::new(1.0, 2.0, std::f64::consts::PI));
        assert_eq!(room.tour.len(), 2);
    }

    #[test]
    fn errors_name_the_line_and_what_to_do() {
        let says = |text: &str| Room::parse(text).unwrap_err().to_string();
        assert!(says("wall 0 0 1 1\nwal 0 0 1 1").starts_with("line 2: `wal` begins no line"));
        assert!(says("wall 0 0 1").contains("3 numbers: write `wall x1"));
        assert!(says("wall 1 1 1 1").contains("length: make it greater"));
        assert!(says("\n\nbox 0 0 -1 2").starts_with("line 3: a box's width"));
        assert!(says("circle 0 0 zero").contains("`zero` is not a finite number"));
        assert!(says("circle 0 0 inf").contains("`inf` is not a finite number"));
        assert!(says("circle 0 0 0").contains("radius"));
        assert!(says("start 0 0 0\nstart 0 0 0").starts_with("line 2: a second start"));
        assert!(says("way 0 0").contains("write `way x y angle`"));
    }
}

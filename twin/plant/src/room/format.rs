//! Rooms as text: one thing per line, `#` starts a comment, lengths in millimetres, angles in
//! degrees.
//!
//! ```text
//! wall x1 y1 x2 y2 [x3 y3 …]      a wall, or a line of walls through more points
//! box x y width depth [angle]     furniture, by its centre
//! circle x y radius               a pillar or a leg
//! soft wall …, soft box …         a curtain, a sofa: no echo from afar
//! sill x1 y1 x2 y2                a door sill or the edge of a carpet
//! start x y angle                 where the robot is put down (once; 0 0 0 if missing)
//! way x y angle                   the next way-point of the tour
//! ```

use geometry::{Point, Segment};

use super::Room;
use crate::Pose2;

/// The largest number, millimetres or degrees: a hundred metres, so that no grid over a room is endless.
pub const FARTHEST: f64 = 100_000.0;

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// The first word is none of the format's.
    #[error(
        "`{0}` begins no line of a room: use wall, box, circle, soft, sill, start or way, and # for a comment"
    )]
    UnknownWord(String),
    /// A word that should be a number, 100 000 at most, is none.
    #[error("`{0}` is no number from -{max} to {max}: write millimetres or degrees, like 1200 or -37.5", max = FARTHEST)]
    NotANumber(String),
    /// The wrong number of numbers follows the first word: what is expected, how many came.
    #[error("{1} numbers: write `{0}`")]
    Count(&'static str, usize),
    /// A width, depth or radius that is not positive, or a wall of no length.
    #[error("{0}: make it greater than zero")]
    Size(&'static str),
    /// `soft` before something that has no soft form.
    #[error("`soft {0}`: write `soft wall …` or `soft box …`")]
    NotSoft(String),
    /// A second `start`.
    #[error("a second start: keep one of them")]
    SecondStart,
}

/// The first error of a room file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct ParseError {
    /// The line, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub problem: Problem,
}

impl Room {
    /// Reads a room from its text.
    ///
    /// # Errors
    /// The first malformed line, and how to correct it.
    pub fn parse(text: &str) -> Result<Self, ParseError> {
        let mut room = Self::default();
        let mut started = false;
        for (line, content) in (1..).zip(text.lines()) {
            let content = content.split('#').next().unwrap_or_default();
            let mut words = content.split_whitespace();
            let Some(word) = words.next() else { continue };
            let soft = (word == "soft").then(|| words.next().unwrap_or_default());
            let numbers = words.map(number).collect::<Result<Vec<f64>, Problem>>();
            room = numbers
                .and_then(|numbers| match soft {
                    Some(word) => room.with_soft_line(word, &numbers),
                    None if word == "start" && std::mem::replace(&mut started, true) => {
                        Err(Problem::SecondStart)
                    }
                    None => room.with_line(word, &numbers),
                })
                .map_err(|problem| ParseError { line, problem })?;
        }
        Ok(room)
    }

    fn with_soft_line(mut self, word: &str, numbers: &[f64]) -> Result<Self, Problem> {
        if !matches!(word, "wall" | "box") {
            return Err(Problem::NotSoft(word.to_owned()));
        }
        let hard = Self::default().with_line(word, numbers)?;
        self.soft.extend(hard.segments);
        Ok(self)
    }

    fn with_line(mut self, word: &str, numbers: &[f64]) -> Result<Self, Problem> {
        let count = |expected| Problem::Count(expected, numbers.len());
        let positive = |sizes: &[f64], what| {
            let all = sizes.iter().all(|&size| size > 0.0);
            all.then_some(()).ok_or(Problem::Size(what))
        };
        match (word, numbers) {
            ("wall", [_, _, _, _, ..]) if numbers.len().is_multiple_of(2) => {
                let (points, _) = numbers.as_chunks();
                for ends in points.array_windows() {
                    let [from, to] = ends.map(|[x, y]| Point::new(x, y));
                    positive(&[from.distance_mm(to)], "a wall's length")?;
                    self.segments.push(Segment::new(from, to));
                }
            }
            ("wall", _) => return Err(count("wall x1 y1 x2 y2, then x y of each further point")),
            ("box", &[x, y, width, depth, ref angle @ ..]) if angle.len() < 2 => {
                positive(&[width, depth], "a box's width or depth")?;
                let angle = angle.first().map_or(0.0, |angle| angle.to_radians());
                self = self.with_box(&Pose2::new(x, y, angle), width, depth);
            }
            ("box", _) => return Err(count("box x y width depth, then its angle if turned")),
            ("circle", &[x, y, radius]) => {
                positive(&[radius], "a circle's radius")?;
                self = self.with_circle(Point::new(x, y), radius);
            }
            ("circle", _) => return Err(count("circle x y radius")),
            ("sill", &[x1, y1, x2, y2]) => {
                let sill = Segment::new(Point::new(x1, y1), Point::new(x2, y2));
                positive(&[sill.length_mm()], "a sill's length")?;
                self.sills.push(sill);
            }
            ("sill", _) => return Err(count("sill x1 y1 x2 y2")),
            ("start", &[x, y, angle]) => self.start = Pose2::new(x, y, angle.to_radians()),
            ("start", _) => return Err(count("start x y angle")),
            ("way", &[x, y, angle]) => self.tour.push(Pose2::new(x, y, angle.to_radians())),
            ("way", _) => return Err(count("way x y angle")),
            (other, _) => return Err(Problem::UnknownWord(other.to_owned())),
        }
        Ok(self)
    }
}

fn number(word: &str) -> Result<f64, Problem> {
    match word.parse::<f64>() {
        Ok(number) if number.abs() <= FARTHEST => Ok(number),
        _ => Err(Problem::NotANumber(word.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_line_is_read() {
        let room = Room::parse(
            "# a room\nwall 0 0 100 0 100 50\nbox 10 20 4 2 90 # turned\n\ncircle 1 2 3\nstart 1 2 180\nway 5 6 -90\nway 7 8 0\nsoft wall 9 9 9 8\nsoft box 0 0 1 1\nsill 3 3 3 4\n",
        )
        .unwrap();
        let walls = Room::default()
            .with_wall(0.0, 0.0, 100.0, 0.0)
            .with_wall(100.0, 0.0, 100.0, 50.0);
        assert_eq!(room.segments[..2], walls.segments);
        let (low, high) = Room {
            segments: room.segments[2..].to_vec(),
            ..Room::default()
        }
        .bounds();
        assert!(low.distance_mm(Point::new(9.0, 18.0)) < 1e-9);
        assert!(high.distance_mm(Point::new(11.0, 22.0)) < 1e-9);
        let curtain = Segment::new(Point::new(9.0, 9.0), Point::new(9.0, 8.0));
        assert_eq!((room.soft[0], room.soft.len()), (curtain, 5));
        assert_eq!(room.segments.len(), 6);
        let sill = Segment::new(Point::new(3.0, 3.0), Point::new(3.0, 4.0));
        assert_eq!(room.sills, [sill]);
        let pillar = Room::default().with_circle(Point::new(1.0, 2.0), 3.0);
        assert_eq!(room.circles, pillar.circles);
        assert_eq!(room.start, Pose2::new(1.0, 2.0, std::f64::consts::PI));
        assert_eq!(room.tour.len(), 2);
    }

    #[test]
    fn errors_name_line_and_correction() {
        for (text, expected) in [
            ("wall 0 0 1 1\nwal 0 0 1 1", "line 2: `wal` begins no line"),
            ("wall 0 0 1", "3 numbers: write `wall x1"),
            ("wall 1 1 1 1", "length: make it greater"),
            ("\n\nbox 0 0 -1 2", "line 3: a box's width"),
            ("box 0 0 1 2 3 4", "6 numbers: write `box"),
            (
                "circle 0 0 zero",
                "`zero` is no number from -100000 to 100000",
            ),
            ("circle 0 0 inf", "`inf` is no number"),
            ("circle 0 1e300 1", "`1e300` is no number"),
            ("circle 0 0 0", "radius"),
            ("start 0 0 0\nstart 0 0 0", "line 2: a second start"),
            ("soft circle 0 0 1", "`soft circle`: write `soft wall"),
            ("soft wall 0 0 1", "3 numbers: write `wall x1"),
            ("soft", "`soft `: write"),
            ("sill 0 0 1", "3 numbers: write `sill"),
            ("sill 0 0 0 0", "a sill's length"),
            ("way 0 0", "write `way x y angle`"),
        ] {
            let message = Room::parse(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}

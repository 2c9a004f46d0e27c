//! The map as the pair of files that ROS map servers read: a PGM picture and a YAML text.

use crate::grid::FARTHEST;
use crate::{Cell, Grid, Point};

/// The picture: binary PGM, one pixel per cell, the top row the largest y; 0 = occupied,
/// 254 = free, 205 = unknown, as the thresholds of [`yaml`] read them.
pub fn pgm(grid: &Grid) -> Vec<u8> {
    let (columns, rows) = (grid.columns(), grid.rows());
    let mut file = format!("P5\n{columns} {rows}\n255\n").into_bytes();
    for row in (0..rows).rev() {
        file.extend((0..columns).map(|column| match grid.cell(column, row) {
            Cell::Occupied => 0,
            Cell::Free => 254,
            Cell::Unknown => 205,
        }));
    }
    file
}

/// The metadata: the picture's name, metres per pixel, and the position of its lower left pixel (x, y
/// in metres, yaw).
pub fn yaml(grid: &Grid, picture: &str) -> String {
    let origin = grid.origin();
    // Between quotes, where a name may hold anything else.
    let quote = if picture.contains(['"', '\\']) {
        '\''
    } else {
        '"'
    };
    format!(
        "image: {quote}{picture}{quote}\nmode: trinary\nresolution: {:.6}\norigin: [{:.6}, {:.6}, 0.0]\nnegate: 0\noccupied_thresh: {}\nfree_thresh: {}\n",
        grid.cell_mm() / 1000.0,
        origin.x_mm / 1000.0,
        origin.y_mm / 1000.0,
        Grid::OCCUPIED,
        Grid::FREE,
    )
}

/// The value of a line `key: value` of the metadata.
///
/// # Errors
/// Names the key that is missing.
pub fn value<'y>(yaml: &'y str, key: &str) -> Result<&'y str, String> {
    let mut lines = yaml.lines().filter_map(|line| line.split_once(':'));
    let found = lines.find(|(found, _)| found.trim() == key);
    let (_, found) = found.ok_or_else(|| format!("no line `{key}:`"))?;
    let found = found.trim();
    let quoted = found.strip_prefix(['"', '\'']);
    if let (Some(quoted), Some(quote)) = (quoted, found.chars().next()) {
        return Ok(quoted.split_once(quote).map_or(found, |(value, _)| value));
    }
    let value = found.split_once(" #").map_or(found, |(value, _)| value);
    Ok(value.trim())
}

/// Log-odds of what a picture calls occupied or free.
const KNOWN: f32 = 4.0;
/// Longest side of what a saved map knows, m: planning and a search on it take some 350 MB.
const MOST_M: f64 = 50.0;

/// The map of a picture and its metadata, which [`pgm`] and [`yaml`] or a ROS map server wrote.
///
/// # Errors
/// What is wrong with either.
pub fn read(yaml: &str, pgm: &[u8]) -> Result<Grid, String> {
    let number = |key: &str| {
        let text = value(yaml, key)?;
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| format!("{key}: {text} is no number"))
    };
    let origin = value(yaml, "origin")?.trim_matches(['[', ']']);
    let origin = origin.split(',').flat_map(|word| word.trim().parse());
    let origin: Vec<f64> = origin.collect();
    let &[x_m, y_m, 0.0] = origin.as_slice() else {
        return Err("origin: expected is [x, y, 0]".into());
    };
    let cell_mm = number("resolution")? * 1000.0;
    if !(1.0..=200.0).contains(&cell_mm) {
        return Err(format!("resolution: {cell_mm} mm is not within 1 to 200"));
    }
    if value(yaml, "mode") == Ok("raw") {
        return Err("mode: raw is not read, but trinary and scale".into());
    }
    let is_negated = match value(yaml, "negate").unwrap_or("0") {
        "0" | "false" => false,
        "1" | "true" => true,
        other => return Err(format!("negate: {other} is not 0, 1, false or true")),
    };
    let (occupied, free) = (number("occupied_thresh")?, number("free_thresh")?);
    let (columns, rows, pixels) =
        picture(pgm).ok_or("the picture is no whole binary PGM of 8 bits")?;
    let log_odds = |pixel: u8| {
        let dark = if is_negated { pixel } else { 255 - pixel };
        match f64::from(dark) / 255.0 {
            share if share > occupied => KNOWN,
            share if share < free => -KNOWN,
            _ => 0.0,
        }
    };
    // A map server's picture is mostly unknown margin.
    let known = (0..pixels.len()).filter(|&at| log_odds(pixels[at]) != 0.0);
    let known = known.map(|at| (at % columns, rows - 1 - at / columns));
    let (low, high) = known.fold(((columns, rows), (0, 0)), |(low, high), (column, row)| {
        let low = (column.min(low.0), row.min(low.1));
        (low, (column.max(high.0), row.max(high.1)))
    });
    if low.0 > high.0 {
        return Err("the picture shows neither floor nor walls".into());
    }
    let corner = Point::new(x_m * 1000.0, y_m * 1000.0);
    #[allow(clippy::cast_precision_loss)] // some thousand cells
    let middle = |(column, row): (usize, usize)| {
        corner + Point::new(column as f64 + 0.5, row as f64 + 0.5) * cell_mm
    };
    let (low, high) = (middle(low), middle(high));
    let Point { x_mm, y_mm } = (high - low) * 0.001;
    if x_mm.max(y_mm) > MOST_M {
        return Err(format!(
            "the map is {x_mm:.0} m by {y_mm:.0} m; accepted are {MOST_M} m"
        ));
    }
    let most_mm = f64::from(FARTHEST) * cell_mm;
    let ends = [low.x_mm, low.y_mm, high.x_mm, high.y_mm];
    if !ends.iter().all(|mm| mm.abs() <= most_mm) {
        return Err(format!(
            "origin: [{x_m}, {y_m}]: the map is not within {FARTHEST} cells of 0, 0"
        ));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // `as` saturates
    let index = |mm: f64| (mm / cell_mm) as usize;
    Ok(Grid::from_fn(cell_mm, low, high, |point| {
        let Point { x_mm, y_mm } = point - corner;
        let (column, row) = (index(x_mm), index(y_mm));
        let from_top = rows.checked_sub(row + 1).filter(|_| column < columns);
        let pixel = from_top.and_then(|row| pixels.get(row * columns + column));
        pixel.map_or(0.0, |&pixel| log_odds(pixel))
    }))
}

/// Columns, rows and pixels of a binary PGM.
fn picture(pgm: &[u8]) -> Option<(usize, usize, &[u8])> {
    let mut rest = pgm;
    let mut word = || {
        while rest.starts_with(b"#") {
            let end = rest.iter().position(|&byte| byte == b'\n')?;
            rest = &rest[end + 1..];
        }
        let end = rest.iter().position(u8::is_ascii_whitespace)?;
        let (word, more) = rest.split_at(end);
        rest = &more[1..];
        std::str::from_utf8(word).ok()
    };
    if word()? != "P5" {
        return None;
    }
    let (columns, rows) = (word()?.parse().ok()?, word()?.parse().ok()?);
    // Without a pixel either could be endless.
    (word()? == "255" && !rest.is_empty() && Some(rest.len()) == usize::checked_mul(columns, rows))
        .then_some((columns, rows, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        let mut grid = Grid::new(25.0);
        let (columns, rows) = grid.cover(-10.0..-10.0, 1040.0..1040.0);
        grid.add(columns.start, rows.start, 5.0);
        grid.add(columns.start, rows.start - 1, -5.0);
        grid
    }

    #[test]
    fn pgm_has_one_byte_per_cell_with_largest_y_on_top() {
        let grid = grid();
        let file = pgm(&grid);
        let header = format!("P5\n{} {}\n255\n", grid.columns(), grid.rows());
        assert!(file.starts_with(header.as_bytes()));
        let pixels = &file[header.len()..];
        assert_eq!(pixels.len(), grid.columns() * grid.rows());
        for (column, row) in grid.cells() {
            let pixel = pixels[(grid.rows() - 1 - row) * grid.columns() + column];
            let middle = grid.middle(column, row);
            let expected = match (middle.x_mm, middle.y_mm) {
                (-12.5, 1037.5) => 0,
                (-12.5, 1012.5) => 254,
                _ => 205,
            };
            assert_eq!(pixel, expected, "{middle:?}");
        }
    }

    #[test]
    fn written_map_reads_back() {
        let grid = grid();
        let (text, file) = (yaml(&grid, "map.pgm"), pgm(&grid));
        let assert_same = |back: &Grid| {
            for (column, row) in grid.cells() {
                let middle = grid.middle(column, row);
                assert_eq!(back.cell_at(middle), grid.cell(column, row), "{middle:?}");
            }
        };
        assert_same(&read(&text, &file).unwrap());
        assert_same(&read(&text.replace("negate: 0", "negate: false"), &file).unwrap());
        // As other programs write it.
        let pixels = file.len() - grid.columns() * grid.rows();
        let (head, pixels) = file.split_at(pixels);
        let head = String::from_utf8_lossy(head).replace("P5\n", "P5\n# CREATOR: map_saver\n");
        let negated = pixels.iter().map(|pixel| 255 - pixel);
        let other: Vec<u8> = head.bytes().chain(negated).collect();
        let words = text.replace("\"map.pgm\"", "'map.pgm' # a map");
        assert_eq!(value(&words, "image"), Ok("map.pgm"));
        assert_same(&read(&words.replace("negate: 0", "negate: 1 # white"), &other).unwrap());
        for (yaml, pgm, expected) in [
            (&*text.replace("trinary", "raw"), &file[..], "raw is not"),
            ("", &file[..], "no line `origin:`"),
            (&text.replace("0.025", "9.025"), &file, "9025 mm is not"),
            (&text.replace("0.0]", "1.0]"), &file, "[x, y, 0]"),
            (&text.replace("te: 0", "te: 2"), &file, "negate: 2 is not"),
            (&text.replace("0.65", "x"), &file, "occupied_thresh: x"),
            (&text, &file[..file.len() - 1], "no whole binary PGM"),
            (&text, b"P2\n", "no whole binary PGM"),
            (&text, b"P5\n2 1\n255\n\xCD\xCD", "neither floor nor walls"),
            (&text, b"P5\n0 9999999999999\n255\n", "no whole binary PGM"),
            (
                &text.replace("origin: [-", "origin: [-90000"),
                &file,
                "is not within",
            ),
            (&text.replace("0.8000", "inf"), &file, "origin: "),
            (&text.replace("0.8000", "49.9"), &file, "2000 cells of 0, 0"),
        ] {
            let error = read(yaml, pgm).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn unknown_margin_of_a_picture_takes_no_room() {
        // Cells of 50 mm, 200 m square, as map servers of ROS write them; floor from 10 m to `end_m`.
        let text = yaml(&grid(), "map.pgm").replace("0.025000", "0.05");
        let text = text.replace("[-0.800000, 0.800000,", "[-100, -100,");
        let picture = |end_m: usize| {
            let mut pixels = vec![205; 4000 * 4000];
            pixels[2000 * 4000 + 2200..][..20 * (end_m - 10)].fill(254);
            [&b"P5\n4000 4000\n255\n"[..], &pixels].concat()
        };
        let map = read(&text, &picture(60)).expect("a map of 50 m");
        assert!(map.columns() < 1100 && map.rows() < 100);
        for (x_mm, expected) in [(9_900.0, Cell::Unknown), (10_100.0, Cell::Free)] {
            assert_eq!(map.cell_at(Point::new(x_mm, -25.0)), expected, "{x_mm}");
        }
        let error = read(&text, &picture(61)).unwrap_err();
        assert!(error.contains("51 m by 0 m; accepted are 50 m"), "{error}");
    }

    #[test]
    fn picture_of_any_name_is_found() {
        for name in ["map.pgm", "floor #2.pgm", "a: b.pgm", "it's.pgm", "6\".pgm"] {
            assert_eq!(value(&yaml(&grid(), name), "image"), Ok(name));
        }
        assert_eq!(value("image: map.pgm # first", "image"), Ok("map.pgm"));
    }

    #[test]
    fn yaml_has_origin_in_metres_and_thresholds() {
        let text = yaml(&grid(), "map.pgm");
        for line in [
            "image: \"map.pgm\"\n",
            "resolution: 0.025000\n",
            "origin: [-0.800000, 0.800000, 0.0]\n",
            "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }
}

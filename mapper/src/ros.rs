//! The map as the pair of files that ROS map servers read: a PGM picture and a YAML text.

use crate::{Cell, Grid};

/// The picture: binary PGM, one pixel per cell, the top row the largest y; 0 = occupied,
/// 254 = free, 205 = unknown, as the thresholds of [`yaml`] read them.
#[must_use]
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
#[must_use]
pub fn yaml(grid: &Grid, picture: &str) -> String {
    let origin = grid.origin();
    format!(
        "image: {picture}\nmode: trinary\nresolution: {:.6}\norigin: [{:.6}, {:.6}, 0.0]\nnegate: 0\noccupied_thresh: {}\nfree_thresh: {}\n",
        grid.cell_mm() / 1000.0,
        origin.x_mm / 1000.0,
        origin.y_mm / 1000.0,
        Grid::OCCUPIED,
        Grid::FREE,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        let mut grid = Grid::new(25.0);
        let (columns, rows) = grid.cover(-10.0..-10.0, 40.0..40.0);
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
                (-12.5, 37.5) => 0,
                (-12.5, 12.5) => 254,
                _ => 205,
            };
            assert_eq!(pixel, expected, "{middle:?}");
        }
    }

    #[test]
    fn thresholds_in_yaml_classify_every_pixel_value() {
        let occupancy = |pixel: u8| (255.0 - f64::from(pixel)) / 255.0;
        assert!(occupancy(0) > 0.65);
        assert!(occupancy(254) < 0.196);
        assert!(occupancy(205) > 0.196 && occupancy(205) < 0.65);
        let text = yaml(&grid(), "map.pgm");
        for line in [
            "image: map.pgm\n",
            "resolution: 0.025000\n",
            "origin: [-0.800000, 0.000000, 0.0]\n",
            "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }
}

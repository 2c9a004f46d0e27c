//! The map as the pair of files that ROS map servers read: a PGM picture and a YAML text.

use crate::{Cell, Grid};

/// The picture: binary PGM, one pixel per cell, the top row the largest y; 0 = occupied,
/// 254 = free, 205 = unknown, which the thresholds of [`yaml`] tell apart again.
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

/// The text that goes with it: the picture's name, metres per pixel, and where its lower left
/// pixel lies (x, y in metres, yaw).
#[must_use]
pub fn yaml(grid: &Grid, picture: &str) -> String {
    let (x, y) = grid.origin_mm();
    format!(
        "image: {picture}\nmode: trinary\nresolution: {:.6}\norigin: [{:.6}, {:.6}, 0.0]\nnegate: 0\noccupied_thresh: {}\nfree_thresh: {}\n",
        grid.cell_mm() / 1000.0,
        x / 1000.0,
        y / 1000.0,
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
    fn the_picture_has_a_byte_per_cell_with_the_largest_y_on_top() {
        let grid = grid();
        let file = pgm(&grid);
        let header = format!("P5\n{} {}\n255\n", grid.columns(), grid.rows());
        assert!(file.starts_with(header.as_bytes()));
        let pixels = &file[header.len()..];
        assert_eq!(pixels.len(), grid.columns() * grid.rows());
        // The occupied cell: x from −25 to 0, y from 25 to 50.
        let (column, row) = grid
            .cells()
            .find(|&(column, row)| grid.middle_mm(column, row) == (-12.5, 37.5))
            .unwrap();
        let pixel =
            |column: usize, row: usize| pixels[(grid.rows() - 1 - row) * grid.columns() + column];
        assert_eq!((pixel(column, row), pixel(column, row - 1)), (0, 254));
        assert!(grid
            .cells()
            .filter(|&(c, r)| c != column || (r != row && r + 1 != row))
            .all(|(c, r)| pixel(c, r) == 205));
    }

    #[test]
    fn the_servers_thresholds_read_every_pixel_as_it_was_meant() {
        let occupancy = |pixel: u8| (255.0 - f64::from(pixel)) / 255.0;
        assert!(occupancy(0) > 0.65);
        assert!(occupancy(254) < 0.196);
        assert!(occupancy(205) > 0.196 && occupancy(205) < 0.65);
    }

    #[test]
    fn the_text_names_the_picture_and_where_it_lies() {
        let text = yaml(&grid(), "map.pgm");
        assert!(text.contains("image: map.pgm\n"));
        assert!(text.contains("resolution: 0.025000\n"));
        assert!(text.contains("origin: [-0.800000, 0.000000, 0.0]\n"));
        assert!(text.contains("occupied_thresh: 0.65\nfree_thresh: 0.196\n"));
    }
}

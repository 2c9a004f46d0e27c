use super::*;

/// A grid from rows of squares of 100 mm, the first row on top; the lower left corner is the
/// origin. `#` is occupied, `.` free.
pub fn draw(rows: &[&str]) -> Grid {
    let size = |count: usize| 100.0 * f64::from(u32::try_from(count).unwrap());
    let high = Point::new(size(rows[0].len()) - 1.0, size(rows.len()) - 1.0);
    Grid::from_fn(25.0, Point::new(0.0, 0.0), high, |point| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // small
        let number = |mm: f64| (mm / 100.0).floor().max(0.0) as usize;
        let row = rows
            .len()
            .checked_sub(1 + number(point.y_mm))
            .map(|row| rows[row]);
        match row.and_then(|row| row.as_bytes().get(number(point.x_mm))) {
            Some(b'#') => 4.0,
            Some(b'.') => -4.0,
            _ => 0.0,
        }
    })
}

/// Floor with obstacles, and unknown corners.
const MIXED: [&str; 7] = [
    "   ......#.",
    " .........#",
    ".....##....",
    "...........",
    ".#.........",
    ".......#...",
    "......#    ",
];

/// The grid moved, so that its first cell is not the origin.
fn moved(rows: &[&str]) -> Grid {
    let grid = draw(rows);
    let (low, high) = (Point::new(-790.0, 410.0), Point::new(350.0, 1190.0));
    Grid::from_fn(25.0, low, high, |point| {
        grid.log_odds_at(point + Point::new(790.0, -410.0))
    })
}

#[test]
fn clearances_are_distances_to_nearest_cells() {
    let grid = moved(&MIXED);
    let middles = |is_source: fn(Cell) -> bool| -> Vec<Point> {
        let cells = grid.cells();
        let sources = cells.filter(|&(column, row)| is_source(grid.cell(column, row)));
        sources
            .map(|(column, row)| grid.middle(column, row))
            .collect()
    };
    let (occupied, hidden) = (
        middles(|cell| cell == Cell::Occupied),
        middles(|cell| cell != Cell::Free),
    );
    let map = CostMap::new(&grid, 0.3, &[], (&[], 100.0));
    assert!((map.direction_rad() - 0.3).abs() < 1e-12);
    let on_grid = |point: Point| {
        let middle = |mm: f64| ((mm / 25.0).floor() + 0.5) * 25.0;
        Point::new(middle(point.x_mm), middle(point.y_mm))
    };
    let (first, last) = (
        grid.middle(0, 0),
        grid.middle(grid.columns() - 1, grid.rows() - 1),
    );
    let mut checked = 0;
    for (index, node) in map.nodes.iter().enumerate() {
        let at = on_grid(map.point(index));
        let is_inside = (first.x_mm..last.x_mm + 1.0).contains(&at.x_mm)
            && (first.y_mm..last.y_mm + 1.0).contains(&at.y_mm);
        if !is_inside {
            assert_eq!((node.cell, node.known_mm), (Cell::Unknown, 0.0));
            continue;
        }
        assert_eq!(node.cell, grid.cell_at(at));
        for (sources, found_mm) in [(&occupied, node.clearance_mm), (&hidden, node.known_mm)] {
            let nearest = sources.iter().map(|source| source.distance_mm(at));
            let nearest_mm = nearest.fold(f64::INFINITY, f64::min);
            assert!(
                (found_mm - nearest_mm).abs() <= 0.05 * nearest_mm,
                "{found_mm} {nearest_mm}"
            );
        }
        checked += 1;
    }
    assert!(checked > 300, "{checked}");
}

#[test]
fn lattice_finds_nodes_by_place() {
    for direction_rad in [0.0, 0.4] {
        let map = CostMap::new(&moved(&MIXED), direction_rad, &[], (&[], 100.0));
        let all = || (0..map.nodes.len()).map(|index| (index, map.point(index)));
        for (index, at) in all() {
            assert_eq!(map.index(at), Some(index));
            let mut beside: Vec<usize> = map.neighbours(index).collect();
            beside.sort_unstable();
            let near = all().filter(|(_, other)| (other.distance_mm(at) - STEP_MM).abs() < 1.0);
            assert_eq!(beside, near.map(|(index, _)| index).collect::<Vec<_>>());
        }
        // To beyond the lattice.
        for nth in 0..900 {
            let at = Point::new(
                -1500.0 + 83.0 * f64::from(nth % 30),
                67.0 * f64::from(nth / 30),
            );
            let lattice = Pose2::at(map.point(0), direction_rad);
            let beside = |(_, node): &(usize, Point)| {
                let [node, at] = [node, &at].map(|p| Pose2::at(*p, 0.0).relative_to(&lattice));
                (node.x_mm - at.x_mm).abs() < 25.0 && (node.y_mm - at.y_mm).abs() < 25.0
            };
            let nearest = all().find(beside).map(|(index, _)| index);
            assert_eq!(map.index(at), nearest);
            for radius_mm in [55.0, 130.0] {
                let near = all().filter(|(_, node)| node.distance_mm(at) <= radius_mm);
                let near: Vec<usize> = near.map(|(index, _)| index).collect();
                let expected = if nearest.is_some() { near } else { Vec::new() };
                assert_eq!(map.within(at, radius_mm), expected);
            }
        }
    }
}

#[test]
fn ways_lead_around_walls_and_lines_do_not_cross_them() {
    let grid = draw(&[
        "#########",
        "#...#...#",
        "#...#...#",
        "#.......#",
        "#########",
    ]);
    let map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
    let at = |x_mm, y_mm| map.index(Point::new(x_mm, y_mm)).unwrap();
    let free = |node: &Node| node.cell == Cell::Free;
    let (from, to) = (Point::new(250.0, 350.0), Point::new(650.0, 350.0));
    let ways_mm = map.ways_mm(at(250.0, 350.0), free);
    assert!((ways_mm[at(250.0, 350.0)]).abs() < 1e-9);
    assert!((ways_mm[at(250.0, 150.0)] - 200.0).abs() < 1e-9);
    let around_mm = ways_mm[at(650.0, 350.0)];
    assert!((750.0..=850.0).contains(&around_mm), "{around_mm}");
    assert!(ways_mm[at(450.0, 350.0)] >= NO_WAY_MM);
    assert!(map.line(from, Point::new(250.0, 150.0), free) && !map.line(from, to, free));
    assert!(!map.line(from, Point::new(390.0, 350.0), free));
    assert!(!map.line(from, Point::new(250.0, 2000.0), |_| true));
}

#[test]
fn body_frees_unknown_cells_around_the_way_and_marks_occupy() {
    let grid = moved(&["    ", "#   ", "    "]);
    let way = Point::new(-690.0, 560.0);
    let mark = Point::new(-600.0, 900.0);
    let marks = [mark, Point::new(-680.0, 570.0)];
    let map = CostMap::new(&grid, 0.0, &marks, (&[way], 120.0));
    let whole = (0..grid.columns(), 0..grid.rows());
    let field = Field::new(&grid, whole, &marks, (&[way], 120.0));
    for (index, (column, row)) in grid.cells().enumerate() {
        let at = grid.middle(column, row);
        let expected = match grid.cell(column, row) {
            _ if marks.iter().any(|mark| mark.distance_mm(at) <= 25.0) => Cell::Occupied,
            Cell::Unknown if at.distance_mm(way) <= 120.0 => Cell::Free,
            _ if at.distance_mm(way) <= 30.0 => Cell::Free,
            cell => cell,
        };
        assert_eq!(field.cells[index], expected, "{at:?}");
    }
    for (index, node) in map.nodes.iter().enumerate() {
        let is_near = map.point(index).distance_mm(way) <= DRIVEN_MM + 0.5 * STEP_MM;
        assert_eq!((node.driven, node.seen), (is_near, [is_near; 2]));
    }
}

#[test]
fn coarse_cells_hide_a_part_of_the_clearance() {
    for (cell_mm, hidden_mm) in [(25.0, 0.0), (50.0, 30.0), (100.0, 90.0)] {
        let (low, high) = (Point::new(0.0, 0.0), Point::new(999.0, 999.0));
        let wall = |point: Point| if point.x_mm > 900.0 { 4.0 } else { -4.0 };
        let grid = Grid::from_fn(cell_mm, low, high, wall);
        let map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
        let node = map.at(Point::new(500.0, 500.0)).expect("on the grid");
        // From middle to middle it is a number of cells, less the 4.5 % of a straight distance.
        let cells = (node.clearance_mm + hidden_mm) / (0.955 * cell_mm);
        assert!((cells - cells.round()).abs() < 0.05, "{cell_mm}: {cells}");
    }
}

#[test]
fn window_is_the_whole_lattice_around_the_points() {
    let grid = moved(&MIXED);
    let (marks, driven) = ([Point::new(-600.0, 900.0)], [Point::new(-300.0, 700.0)]);
    let whole = CostMap::new(&grid, 0.3, &marks, (&driven, 100.0));
    for points in [
        &[Point::new(-310.0, 720.0)][..],
        &[Point::new(-600.0, 850.0), Point::new(-250.0, 650.0)],
        // Nearer to the grid's rim than the window is wide.
        &[Point::new(-780.0, 420.0)],
    ] {
        let window = whole.around(points, 400.0, &grid, (&marks, (&driven, 100.0)));
        assert!(window.nodes.len() < whole.nodes.len(), "{points:?}");
        let within = |at: Point, mm: f64| points.iter().any(|point| point.distance_mm(at) <= mm);
        let mut near = 0;
        for (index, node) in whole.nodes.iter().enumerate() {
            let at = whole.point(index);
            assert!(window.index(at).is_some() || !within(at, 400.0), "{at:?}");
            if within(at, 150.0) {
                let twin = window.index(at).expect("in the window");
                assert!(window.point(twin).distance_mm(at) < 1e-6);
                let same = |node: &Node| {
                    let up_to = |mm: f64| mm.min(240.0);
                    let clearances = (up_to(node.clearance_mm), up_to(node.known_mm));
                    (clearances, node.cell, node.driven, node.seen)
                };
                assert_eq!(same(&window.nodes[twin]), same(node), "{at:?}");
                near += 1;
            }
        }
        assert!(near >= 9, "{points:?}");
    }
}

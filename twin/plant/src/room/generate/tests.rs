use super::*;

const SEEDS: u32 = 20;

#[test]
fn generated_rooms_keep_to_their_figures() {
    assert_eq!(generate(3), generate(3));
    let (mut slanted, mut soft, mut legs, mut sills, mut counts) = (0, 0, 0, 0, Vec::new());
    for seed in 0..SEEDS.into() {
        let room = generate(seed);
        let start = room.start.position();
        assert!(room.clearance_mm(start) >= START_MM - CELL_MM, "{seed}");
        let (low, high) = room.bounds();
        let area = (high.x_mm - low.x_mm) * (high.y_mm - low.y_mm) / 1e6;
        assert!((12.0..=40.5).contains(&area), "{seed}: {area} m²");
        // What the body passes with 50 mm to spare is no narrower than 450 mm, but for pockets.
        let grid = ClearanceGrid::new(&room);
        let mut near = grid.flood(start, PASSAGE_MM);
        let open = near.iter().filter(|&&cell| cell).count();
        for _ in 0..=POCKET_CELLS {
            near = grid.grown(&near);
        }
        let floor = grid.flood(start, REACHABLE_MM);
        let mut cells = floor.iter().zip(&near);
        assert!(cells.all(|(&floor, &near)| !floor || near), "{seed}");
        #[allow(clippy::cast_precision_loss)]
        let open_m2 = open as f64 * (CELL_MM / 1000.0).powi(2);
        assert!(open_m2 > area / 5.0, "{seed}: {open_m2} of {area} m²");
        let oblique = |s: &Segment| {
            (s.from.x_mm - s.to.x_mm).abs() > 1.0 && (s.from.y_mm - s.to.y_mm).abs() > 1.0
        };
        slanted += u32::from(room.segments.iter().any(oblique));
        soft += u32::from(!room.soft.is_empty());
        legs += u32::from(room.circles.iter().any(|c| c.radius_mm < 30.0));
        sills += u32::from(!room.sills.is_empty());
        counts.push(room.segments.len());
    }
    for some in [slanted, soft, legs, sills] {
        assert!(
            (5..=SEEDS).contains(&some),
            "{slanted} {soft} {legs} {sills}"
        );
    }
    assert!(counts.iter().min() >= Some(&16), "{counts:?}");
}

//! The live terminal of `monitor` and `teleop`: map, robot, link, advice, log, keys.

use super::connection::interrupt;
use super::monitor;
use super::output::Output;
use host_link::error::Error;
use mapper::{Cell, Point};
use pilot::client::{Client, View};
use pilot::serve::protocol::{self, Estimate, Message};
use pilot::teleop::{self, DeadMan, Key, Shown};
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Text};
use ratatui::widgets::canvas::{Canvas, Points};
use ratatui::widgets::{Block, Paragraph, Wrap};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Time between two pictures.
const REFRESH: Duration = Duration::from_millis(100);
/// Lines of the log that are kept.
const LOG_LINES: usize = 50;

/// What the screen shows.
#[derive(Default)]
struct Screen {
    view: View,
    log: VecDeque<String>,
    /// Why the last motion ended, or was refused.
    note: Option<String>,
    drives: bool,
}

impl Screen {
    fn take(&mut self, shown: &Shown<'_>) {
        match shown {
            Shown::Message(message) => {
                self.view.take(message);
                match message {
                    Message::Log { line } => {
                        self.log.truncate(LOG_LINES - 1);
                        self.log.push_front(line.clone());
                    }
                    Message::Done { error, .. } => {
                        self.note = error.as_ref().map(|why| why.text.clone());
                    }
                    _ => {}
                }
            }
            Shown::Refused(why) => self.note = Some((*why).into()),
            Shown::Nothing => {}
        }
    }
}

/// Shows the robot until the user leaves; with `dead_man` the keys drive it.
pub fn run(client: &mut Client, dead_man: Option<DeadMan>) -> Result<(), Error> {
    struct Restore;
    impl Drop for Restore {
        fn drop(&mut self) {
            ratatui::restore();
        }
    }
    let unwritable = |cause: std::io::Error| Error::unwritable("the terminal", &cause);
    let mut terminal = ratatui::try_init().map_err(unwritable)?;
    let _restore = Restore;
    let mut screen = Screen {
        drives: dead_man.is_some(),
        ..Screen::default()
    };
    let mut drawn: Option<Instant> = None;
    teleop::run(client, &interrupt()?, dead_man, |shown| {
        screen.take(&shown);
        if drawn.is_none_or(|drawn| drawn.elapsed() >= REFRESH) {
            drawn = Some(Instant::now());
            let draw = |frame: &mut Frame<'_>| draw(frame, &screen);
            terminal.draw(draw).map_err(unwritable)?;
        }
        let mut keys = Vec::new();
        // crossterm reads from a terminal that has hung up for ever.
        while Output::check_reader()
            .and_then(|()| event::poll(Duration::ZERO).map_err(unwritable))?
        {
            keys.extend(key(&event::read().map_err(unwritable)?));
        }
        Ok(keys)
    })
}

/// The key of an event; a change of the size shows with the next picture.
fn key(event: &Event) -> Option<Key> {
    let Event::Key(key) = event else { return None };
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    Some(match key.code {
        KeyCode::Char('c') if control => Key::Leave,
        KeyCode::Char('q') | KeyCode::Esc => Key::Leave,
        KeyCode::Char(' ') => Key::Stop,
        KeyCode::Char('w') | KeyCode::Up => Key::Ahead,
        KeyCode::Char('s') | KeyCode::Down => Key::Back,
        KeyCode::Char('a') | KeyCode::Left => Key::Left,
        KeyCode::Char('d') | KeyCode::Right => Key::Right,
        _ => return None,
    })
}

// Requirement: SERVE-terminal-1
/// Draws everything, at any size; 80 × 24 shows all of it.
fn draw(frame: &mut Frame<'_>, screen: &Screen) {
    let rows = [
        Constraint::Length(1),
        Constraint::Fill(1),
        Constraint::Length(7),
        Constraint::Length(1),
    ];
    let [title, middle, messages, keys] = Layout::vertical(rows).areas(frame.area());
    let columns = [Constraint::Fill(1), Constraint::Length(36)];
    let [map, robot] = Layout::horizontal(columns).areas(middle);
    let known = screen.view.frame.as_ref();
    let head = known.map_or("connecting …".into(), headline);
    frame.render_widget(Line::from(head).bold().reversed(), title);
    draw_map(frame, map, &screen.view);
    let text = Paragraph::new(known.map(robot_text).unwrap_or_default()).wrap(Wrap { trim: true });
    frame.render_widget(text.block(Block::bordered().title("robot")), robot);

    let warnings = known
        .iter()
        .flat_map(|known| known.error.iter().chain(&known.advice));
    let warnings = warnings.chain(&screen.note);
    let mut lines: Vec<_> = warnings
        .map(|text| Line::from(format!("! {text}")).fg(Color::Red))
        .collect();
    let room = usize::from(messages.height.saturating_sub(2));
    let log = screen.log.iter().take(room.saturating_sub(lines.len()));
    lines.extend(log.rev().map(|line| Line::from(line.as_str())));
    let block = Block::bordered().title("advice and log");
    frame.render_widget(Paragraph::new(Text::from(lines)).block(block), messages);
    let drive = "arrows or WASD drive while held   space STOP   q leaves and stops";
    let look = "space STOP   q leaves";
    let help = if screen.drives { drive } else { look };
    frame.render_widget(Line::from(help).reversed(), keys);
}

fn headline(known: &protocol::Frame) -> String {
    let driver = known.driver.as_deref().unwrap_or("no client");
    let (mode, clients) = (known.robot.mode, known.clients);
    format!(" {mode}, driven by {driver} ({clients} clients)")
}

fn robot_text(known: &protocol::Frame) -> String {
    let robot = &known.robot;
    let stm = robot.stm.as_ref().map_or("no log".into(), monitor::stm);
    let mut lines = vec![
        monitor::robot(robot),
        format!("Pi: {}", monitor::pi(&robot.link)),
        format!("STM: {stm}"),
    ];
    if let Some(Estimate { pose, deviation_mm }) = known.estimate {
        let (x, y) = (pose.x_mm, pose.y_mm);
        lines.insert(
            1,
            format!("on the map x {x:.0} mm y {y:.0} mm ± {deviation_mm:.0}"),
        );
    }
    lines.join("\n")
}

/// The map, as large as it fits, a cell at most as large as half a character.
fn draw_map(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let (grid, block) = (view.grid(), Block::bordered().title("map"));
    let inside = block.inner(area);
    let cells = |state| {
        let cells = grid.cells().filter(|&(x, y)| grid.cell(x, y) == state);
        let middles = cells.map(|(column, row)| grid.middle(column, row));
        middles.map(|at| (at.x_mm, at.y_mm)).collect::<Vec<_>>()
    };
    let (free, occupied) = (cells(Cell::Free), cells(Cell::Occupied));
    let all = free.iter().chain(&occupied);
    let corners = Point::bounds(all.map(|&(x_mm, y_mm)| Point::new(x_mm, y_mm)));
    let (low, high) = corners.unwrap_or_default();
    let extent = high - low;
    let (wide, tall) = (f64::from(inside.width), 2.0 * f64::from(inside.height));
    let mm = (extent.x_mm / wide).max(extent.y_mm / tall);
    let mm = mm.max(grid.cell_mm());
    let bounds = |low: f64, high: f64, halves: f64| {
        let middle = f64::midpoint(low, high);
        [middle - mm * halves / 2.0, middle + mm * halves / 2.0]
    };
    let canvas = Canvas::default()
        .block(block)
        .marker(Marker::HalfBlock)
        .x_bounds(bounds(low.x_mm, high.x_mm, wide))
        .y_bounds(bounds(low.y_mm, high.y_mm, tall))
        .paint(|picture| {
            for (coords, color) in [(&free, Color::DarkGray), (&occupied, Color::White)] {
                picture.draw(&Points { coords, color });
            }
            if let Some(Estimate { pose, .. }) =
                view.frame.as_ref().and_then(|known| known.estimate)
            {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 8
                let eighth = (pose.rotation_deg.rem_euclid(360.0) / 45.0).round() as usize;
                let arrow = ["→", "↗", "↑", "↖", "←", "↙", "↓", "↘"][eighth % 8];
                picture.print(pose.x_mm, pose.y_mm, arrow.fg(Color::Red));
            }
        });
    frame.render_widget(canvas, area);
}

#[cfg(test)]
mod tests {
    use super::*;
    use fw_core::eeprom::{Config, Image};
    use host_link::pose::Pose;
    use host_link::snapshot::Snapshot;
    use pilot::serve::protocol::{Activity, Tile};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn screen() -> Screen {
        let mut robot = Snapshot::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
        robot.pose = Some(Pose::new(100.0, 200.0, 30.0));
        robot.ranges_mm = [Some(812.0), None, None];
        (robot.state, robot.faults) = (Some("faulted"), vec!["left-stalled"]);
        let (pose, deviation_mm) = (Pose::new(400.0, 400.0, -90.0), 12.0);
        let frame = protocol::Frame {
            robot,
            estimate: Some(Estimate { pose, deviation_mm }),
            activity: Activity::Explore,
            driver: Some("page".into()),
            targets: 3,
            advice: vec!["latched fault left-stalled: remove what blocks it".into()],
            error: None,
            clients: 2,
            rangefinders: [Some(Pose::new(80.0, 0.0, 0.0)), None, None],
            stop_deadline_ms: 250,
        };
        let is_wall = |index: i32| index % 32 == 0 || index < 32;
        let cell = |index| if is_wall(index) { '#' } else { '.' };
        let (column, row, cells) = (0, 0, (0..32 * 32).map(cell).collect());
        let tiles = vec![Tile { column, row, cells }];
        let (cell_mm, line) = (25.0, "I00042: link frames 40".into());
        let mut screen = Screen::default();
        for message in [
            Message::Map { cell_mm },
            Message::Tiles { tiles },
            Message::Log { line },
            Message::Frame(Box::new(frame)),
        ] {
            screen.take(&Shown::Message(&message));
        }
        screen.take(&Shown::Refused("another client drives the robot"));
        screen
    }

    fn drawn(screen: &Screen, columns: u16, rows: u16) -> Terminal<TestBackend> {
        let mut terminal = Terminal::new(TestBackend::new(columns, rows)).unwrap();
        terminal.draw(|frame| draw(frame, screen)).unwrap();
        terminal
    }

    // Requirement: SERVE-terminal-1
    #[test]
    fn screen_of_80_by_24_shows_everything() {
        let terminal = drawn(&screen(), 80, 24);
        let text = terminal.backend().to_string();
        for expected in [
            "Normal, driven by page (2 clients)",
            "100.0 mm",
            "front  812",
            "(left-stalled)",
            "on the map x 400 mm y 400 mm ± 12",
            "Pi: 0 frames",
            "STM: no log",
            "! latched fault left-stalled",
            "! another client drives",
            "I00042: link frames 40",
            "space STOP",
            "↓",
        ] {
            assert!(text.contains(expected), "{expected}:\n{text}");
        }
        // A wall along the left and the lower edge, each cell at most half a character.
        let cells = terminal.backend().buffer().content.iter();
        let walls = cells.filter(|cell| cell.fg == Color::White || cell.bg == Color::White);
        let walls = walls.count();
        assert!((30..50).contains(&walls), "{walls}:\n{text}");
    }

    // Requirement: SERVE-terminal-1
    #[test]
    fn screen_fits_any_size_of_the_terminal() {
        for (columns, rows) in [(1, 1), (10, 5), (37, 12), (79, 23), (200, 60), (400, 8)] {
            drawn(&screen(), columns, rows);
            drawn(&Screen::default(), columns, rows);
        }
    }

    #[test]
    fn key_of_an_event_has_its_meaning() {
        let pressed = |code: char, modifiers| event::KeyEvent::new(KeyCode::Char(code), modifiers);
        let event = |code, modifiers| Event::Key(pressed(code, modifiers));
        let mut released = pressed('d', KeyModifiers::NONE);
        released.kind = KeyEventKind::Release;
        assert_eq!(key(&Event::Key(released)), None);
        for (code, expected) in [('d', Some(Key::Right)), (' ', Some(Key::Stop)), ('c', None)] {
            assert_eq!(key(&event(code, KeyModifiers::NONE)), expected, "{code}");
        }
        assert_eq!(key(&event('c', KeyModifiers::CONTROL)), Some(Key::Leave));
        assert_eq!(key(&Event::Resize(80, 24)), None);
    }
}

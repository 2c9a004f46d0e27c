//! The control loop and its clients on a board in memory.

mod borrowing;
mod connections;
mod driving;

use fw_core::eeprom::{Image, fields};
use fw_core::wire::{Command, Mode, Order};
use host_link::board_io::Interrupt;
use host_link::eeprom::journal::Journal;
use host_link::mock_board::{OnCommand, Shared, mock_board};
use pilot::client::Client;
use pilot::mapping::BODY_MM;
use pilot::serve::control::{self, Options};
use pilot::serve::hub::Hub;
use pilot::serve::protocol::{Activity, Message, Request};
use std::thread;
use std::time::{Duration, Instant};

/// Serves a board in Guarded Velocity while the scenario runs; every command that the board got.
fn serve(speed: Option<f64>, scenario: impl FnOnce(&Hub) + Send) -> Vec<Command> {
    let board = Served::at(speed).run(scenario);
    std::mem::take(&mut board.borrow_mut().commands)
}

/// The first board's EEPROM in this mode.
fn in_mode(mode: Mode) -> Image {
    Image::FIRST_BOARD.with(fields::MODE, mode.code().into())
}

/// A board in memory, its EEPROM, and how it is served.
struct Served {
    eeprom: Image,
    speed: Option<f64>,
    /// What each reading of its clock takes, µs.
    reading_us: u64,
    journal: Option<Journal>,
    on_command: Option<OnCommand>,
}

impl Served {
    /// In Guarded Velocity, without a journal.
    fn at(speed: Option<f64>) -> Self {
        Self {
            eeprom: in_mode(Mode::GuardedVelocity),
            speed,
            reading_us: 0,
            journal: None,
            on_command: None,
        }
    }

    /// Serves it while the scenario runs; the board.
    fn run(self, scenario: impl FnOnce(&Hub) + Send) -> Shared {
        let (hub, events) = Hub::new();
        let (board, mut io) = mock_board(&self.eeprom, None);
        board.borrow_mut().on_command = self.on_command;
        let (clocked, reading_us) = (board.clone(), self.reading_us);
        io.clock = Box::new(move || {
            clocked.borrow_mut().now_us += reading_us;
            clocked.borrow().now_us
        });
        let end = io.interrupt.raised_on_drop();
        let options = Options {
            rate_hz: 40,
            ready_timeout_ms: 60_000,
            body_mm: BODY_MM,
            speed: self.speed,
            journal: self.journal,
        };
        thread::scope(|scope| {
            let scenario = scope.spawn(move || {
                let _end = end;
                scenario(&hub);
            });
            control::run(&mut io, &options, events).unwrap();
            scenario.join().unwrap();
        });
        board
    }
}

const EXPLORE: Request = Request::Explore { lease_ms: 2000 };

fn join(hub: &Hub, name: &str) -> Client {
    Client::local(hub.admit().unwrap(), name, &Interrupt::new()).unwrap()
}

fn drive(forward_mm_s: f64, lease_ms: u32) -> Request {
    Request::Drive {
        forward_mm_s,
        yaw_rate_deg_s: 0.0,
        lease_ms,
    }
}

fn time_us(client: &mut Client) -> u64 {
    client.status().unwrap().robot.time_us
}

/// Waits until the client's motion has ended; why it ended.
fn end_of_motion(client: &mut Client) -> String {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < Duration::from_secs(50));
        if let Some(Message::Done { error, .. }) = client.message().unwrap() {
            return error.map_or_else(String::new, |error| error.text);
        }
    }
}

/// Frames from the last one that drives until the stop order, and the speeds of those that drove.
fn stops(commands: &[Command]) -> (usize, Vec<i32>) {
    let speeds = commands.iter().map(|command| command.velocity.forward);
    let mut speeds: Vec<_> = speeds.collect();
    let last = speeds.iter().rposition(|&speed| speed != 0).unwrap();
    let is_stop = |command: &Command| command.order == Order::Stop;
    let stop = commands[last..].iter().position(is_stop);
    speeds.retain(|&speed| speed != 0);
    speeds.dedup();
    (stop.unwrap(), speeds)
}

#[test]
fn frames_during_slow_work_do_not_keep_the_velocity_of_an_earlier_motion() {
    let served = Served {
        // A frame is over before the work on its report is.
        reading_us: 5_000,
        ..Served::at(None)
    };
    let board = served.run(|hub| {
        let mut driver = join(hub, "driver");
        for (motion, activity) in [
            (drive(37.0, 5000), Activity::Drive),
            (EXPLORE, Activity::Explore),
        ] {
            driver.request(&motion).unwrap();
            while driver.status().unwrap().activity != activity {}
        }
        let begun_us = time_us(&mut driver);
        while time_us(&mut driver) < begun_us + 1_000_000 {}
    });
    let commands = &board.borrow().commands;
    let is_stop = |command: &Command| command.order == Order::Stop;
    let (driven, explored) = commands.split_at(commands.iter().position(is_stop).unwrap());
    let keeps = |one: &Command| one.velocity.forward == 37_000;
    assert!(driven.iter().any(keeps) && !explored.iter().any(keeps));
}

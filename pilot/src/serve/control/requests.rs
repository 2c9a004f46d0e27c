//! What the clients ask for, and who may drive.

use super::{CELL_MM, Lease, Motion, Next, Server};
use crate::exploring::{ensure_velocity, navigator_config};
use crate::serve::hub::{ClientId, Event, MAX_CLIENTS};
use crate::serve::protocol::{Activity, Message, Request};
use fw_core::eeprom::Config;
use host_link::error::{Error, Exit};
use host_link::pose::Pose;
use host_link::session::VelocityRequest;
use mapper::Point;
use navigator::{Explorer, GoTo};
use std::time::{Duration, Instant};

/// Without a velocity for so long, a client that was stopped has let go of its handle.
const LET_GO: Duration = Duration::from_millis(500);

impl Server {
    pub(super) fn handle_events(&mut self) {
        // A client that asks again at once waits for the next frame.
        let events: Vec<_> = self.events.try_iter().take(MAX_CLIENTS).collect();
        for event in events {
            self.handle_event(event);
        }
        self.check_lease();
    }

    pub(super) fn handle_event(&mut self, event: Event) {
        match event {
            Event::Joined(client) => {
                let id = client.id;
                self.clients.insert(id, client);
                self.reply(id, &Ok(()));
            }
            Event::Asked(id, Err(what)) => self.reply(id, &Err(refused(&what, Exit::Usage))),
            Event::Asked(id, Ok(request)) => {
                let outcome = self.handle(id, &request);
                // A robot that is borrowed is confirmed once it is lent.
                if request != Request::Borrow || outcome.is_err() {
                    self.reply(id, &outcome);
                }
            }
            Event::Left(id) => {
                self.clients.remove(&id);
            }
        }
    }

    // Requirement: SERVE-drive-2
    pub(super) fn check_lease(&mut self) {
        if let Some(lease) = &self.lease {
            let name = &lease.name;
            if !self.clients.contains_key(&lease.client) {
                self.cancel(&format!("{name} has disconnected"));
            } else if lease.is_over() {
                self.cancel(&format!("the lease of {name} has ended"));
            }
        }
    }

    fn cancel(&mut self, text: &str) {
        if let (Some(Next::Lend), Some(lease)) = (self.next.take(), &self.lease) {
            self.reply(lease.client, &Err(refused(text, Exit::NotReached)));
        }
        if self.activity == Activity::Idle {
            self.lease = None;
        } else {
            self.cancelled = Some(refused(text, Exit::NotReached));
        }
    }

    fn handle(&mut self, id: ClientId, request: &Request) -> Result<(), Error> {
        match *request {
            Request::Hello { .. } => return Err(refused("the first message is over", Exit::Usage)),
            Request::Status => {
                let frame = self.latest.clone();
                let mut frame = frame.ok_or_else(|| refused("no frame yet", Exit::Link))?;
                // Also those who have come since.
                frame.clients = self.clients.len();
                self.send_to(id, &Message::Frame(Box::new(frame)));
            }
            Request::Watch { every } => {
                let message = Message::Map { cell_mm: CELL_MM };
                if let Some(client) = self.clients.get_mut(&id) {
                    (client.every, client.tiles) = (Some(every), 0);
                }
                self.send_to(id, &message);
            }
            Request::Drive {
                forward_mm_s,
                yaw_rate_deg_s,
                lease_ms,
            } => {
                ensure_velocity(self.config()?)?;
                self.has_let_go(id, (forward_mm_s, yaw_rate_deg_s) == (0.0, 0.0))?;
                self.take_lease(id, lease_ms)?;
                self.velocity = VelocityRequest {
                    forward_mm_s,
                    yaw_rate_deg_s,
                    ..VelocityRequest::default()
                };
                if self.activity != Activity::Drive {
                    self.begin(Next::Motion(Motion::Velocity));
                }
            }
            Request::Goto {
                x_mm,
                y_mm,
                rotation_deg,
                lease_ms,
            } => {
                let motion = if let Some(rotation_deg) = rotation_deg {
                    Motion::Pose(Pose::new(x_mm, y_mm, rotation_deg))
                } else {
                    let plan = GoTo::new(
                        navigator_config(self.config()?, self.body_mm)?,
                        Point::new(x_mm, y_mm),
                    );
                    Motion::Plan(Activity::Goto, Box::new(plan))
                };
                self.take_lease(id, lease_ms)?;
                self.begin(Next::Motion(motion));
            }
            Request::Explore { lease_ms } => {
                let plan = Explorer::new(navigator_config(self.config()?, self.body_mm)?);
                self.take_lease(id, lease_ms)?;
                self.begin(Next::Motion(Motion::Plan(
                    Activity::Explore,
                    Box::new(plan),
                )));
            }
            Request::Keep => match &mut self.lease {
                Some(lease) if lease.client == id && lease.ends.is_some() => {
                    lease.ends = Some(Instant::now() + lease.length);
                }
                _ => return Err(refused("this client does not drive", Exit::Usage)),
            },
            Request::Stop => self.stop(id),
            Request::ClearFaults => {
                self.reachable_for(id)?;
                self.begin(Next::Motion(Motion::Clear));
            }
            Request::NewMap => {
                self.reachable_for(id)?;
                if matches!(self.activity, Activity::Goto | Activity::Explore) {
                    let text = "the robot drives by the map; `robot stop` ends that";
                    return Err(refused(text, Exit::Busy));
                }
                self.pose = None;
            }
            Request::Borrow => {
                self.free_for(id)?;
                if self.loan.is_some() {
                    return Err(refused("the robot is borrowed already", Exit::Busy));
                }
                // Without frames the robot's own stop deadline ends its motion.
                self.lease = Some(self.lease_of(id, Duration::ZERO, None));
                self.begin(Next::Lend);
            }
            Request::Board { .. } | Request::Return => {
                let client = self.clients.get(&id);
                if let Some(why) = client.and_then(|client| client.loan_ended.clone()) {
                    return Err(why.into());
                }
                let text = "this client has not borrowed the robot";
                return Err(refused(text, Exit::Usage));
            }
        }
        Ok(())
    }

    // Requirement: SERVE-drive-1
    fn stop(&mut self, id: ClientId) {
        let text = format!("stopped by {}", self.name(id));
        let driver = self.lease.as_ref().map(|lease| lease.client);
        if let Some(driver) = driver.filter(|&driver| driver != id)
            && let Some(client) = self.clients.get_mut(&driver)
        {
            client.held = Some(Instant::now());
        }
        if self.activity != Activity::Idle {
            return self.cancel(&text);
        }
        let error = refused(&text, Exit::NotReached);
        match (self.next.replace(Next::Motion(Motion::Stop)), &self.lease) {
            (Some(Next::Lend), Some(lease)) => self.reply(lease.client, &Err(error)),
            (Some(Next::Motion(waiting)), _) => {
                self.report_end(waiting.activity(), Some(&error), 0.0);
            }
            _ => {}
        }
        self.lease = None;
    }

    /// Begins a motion in place of the present one.
    fn begin(&mut self, next: Next) {
        if self.activity != Activity::Idle {
            self.cancel("another motion of the same client follows");
        }
        self.next = Some(next);
    }

    /// # Errors
    /// Another client drives, or the robot cannot be reached.
    fn reachable_for(&self, id: ClientId) -> Result<(), Error> {
        if let Some(error) = self.latest.as_ref().and_then(|frame| frame.error.as_ref()) {
            return Err(refused(error, Exit::Link));
        }
        self.free_for(id)
    }

    /// # Errors
    /// Another client drives.
    fn free_for(&self, id: ClientId) -> Result<(), Error> {
        match &self.lease {
            Some(lease) if lease.client != id => {
                let text = format!("{} drives the robot; `robot stop` ends that", lease.name);
                Err(refused(&text, Exit::Busy))
            }
            _ => Ok(()),
        }
    }

    // Requirement: SERVE-drive-1
    fn take_lease(&mut self, id: ClientId, lease_ms: u32) -> Result<(), Error> {
        self.reachable_for(id)?;
        let length = Duration::from_millis(lease_ms.into());
        self.lease = Some(self.lease_of(id, length, Some(Instant::now() + length)));
        Ok(())
    }

    fn lease_of(&self, client: ClientId, length: Duration, ends: Option<Instant>) -> Lease {
        Lease {
            client,
            name: self.name(client),
            length,
            ends,
        }
    }

    /// # Errors
    /// Another client has stopped this one, which has sent velocities since, as a handle that is held does;
    /// one that `rests` sends zeros.
    // Requirement: SERVE-drive-1
    fn has_let_go(&mut self, id: ClientId, rests: bool) -> Result<(), Error> {
        let Some(client) = self.clients.get_mut(&id) else {
            return Ok(());
        };
        client.held = client.held.filter(|held| held.elapsed() < LET_GO);
        if let Some(held) = &mut client.held {
            if !rests {
                *held = Instant::now();
            }
            let text = "another client has stopped the robot: let go before you drive on";
            return Err(refused(text, Exit::Busy));
        }
        Ok(())
    }

    fn name(&self, id: ClientId) -> String {
        let client = self.clients.get(&id);
        client.map(|client| client.name.clone()).unwrap_or_default()
    }

    fn config(&self) -> Result<&Config, Error> {
        let unknown = || refused("the robot has not answered yet", Exit::NotReady);
        self.config.as_ref().ok_or_else(unknown)
    }
}

pub(super) fn refused(text: &str, exit: Exit) -> Error {
    let text = text.into();
    Error::Server { text, exit }
}

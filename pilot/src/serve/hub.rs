//! The clients of the control loop: bounded queues out, one request at a time each in.

use super::protocol::{Failure, Request};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender, SyncSender};
use std::time::Instant;

/// Most clients at a time …
pub const MAX_CLIENTS: usize = 64;
/// … and while this many are there, none joins over a network: this computer's `stop` has a place.
pub const MAX_WITH_NETWORK: usize = 48;
/// Messages that a client may be behind before it is dropped: 12 s of frames.
const QUEUE: usize = 512;

/// Identifies a client.
pub type ClientId = usize;

/// What clients do, in the order in which the control loop handles it.
pub enum Event {
    /// A client has been accepted.
    Joined(Client),
    /// A client asks for something, or for what is no request.
    Asked(ClientId, Result<Request, String>),
    /// A client has gone.
    Left(ClientId),
}

/// A client as the control loop sees it.
pub struct Client {
    /// Its number.
    pub id: ClientId,
    /// Its name.
    pub name: String,
    /// It watches every n-th frame.
    pub every: Option<u32>,
    /// Tiles of the map that it has got.
    pub tiles: usize,
    /// When it last sent a velocity after another client had stopped it.
    pub held: Option<Instant>,
    /// Why its loan of the robot ended.
    pub loan_ended: Option<Failure>,
    // Dropped before the queue, whose end wakes the reader: it finds out why.
    answered: SyncSender<()>,
    queue: SyncSender<Arc<str>>,
}

impl Client {
    /// Queues a message; whether the client keeps up.
    // Requirement: SERVE-client-2
    #[must_use]
    pub fn send(&self, message: &Arc<str>) -> bool {
        self.queue.try_send(Arc::clone(message)).is_ok()
    }

    /// Its request is answered: the next may come.
    pub fn answered(&self) {
        let _ = self.answered.try_send(());
    }
}

/// Where clients join. Clones lead to the same control loop.
#[derive(Clone)]
pub struct Hub {
    events: Sender<Event>,
    clients: Arc<AtomicUsize>,
    most: usize,
    next: Arc<AtomicUsize>,
}

impl Hub {
    /// A hub, and the events for the control loop.
    pub fn new() -> (Self, Receiver<Event>) {
        let (events, receiver) = mpsc::channel();
        let hub = Self {
            events,
            clients: Arc::default(),
            most: MAX_CLIENTS,
            next: Arc::default(),
        };
        (hub, receiver)
    }

    /// The same hub for the clients of a network.
    #[must_use]
    pub fn of_network(&self) -> Self {
        Self {
            most: MAX_WITH_NETWORK,
            ..self.clone()
        }
    }

    /// A place for one more client, if there is one.
    pub fn admit(&self) -> Option<Port> {
        let place = |count| (count < self.most).then_some(count + 1);
        let (done, missed) = (Ordering::AcqRel, Ordering::Acquire);
        self.clients.fetch_update(done, missed, place).ok()?;
        let (id, hub) = (self.next.fetch_add(1, Ordering::Relaxed), self.clone());
        Some(Port { id, hub })
    }
}

/// A client's place.
pub struct Port {
    id: ClientId,
    hub: Hub,
}

impl Port {
    /// Joins under this name: the client's messages, the first of which is the reply, and a signal for each
    /// answer. Both end once the control loop has ended or has dropped the client.
    pub fn join(&self, name: String) -> (Receiver<Arc<str>>, Receiver<()>) {
        let (queue, messages) = mpsc::sync_channel(QUEUE);
        let (answered, answers) = mpsc::sync_channel(1);
        let client = Client {
            id: self.id,
            name,
            every: None,
            tiles: 0,
            held: None,
            loan_ended: None,
            answered,
            queue,
        };
        let _ = self.hub.events.send(Event::Joined(client));
        (messages, answers)
    }

    /// Passes a request on, or why it is refused.
    pub fn ask(&self, request: Result<Request, String>) {
        let _ = self.hub.events.send(Event::Asked(self.id, request));
    }

    /// The control loop drops the client, whose place is still taken.
    pub fn leave(&self) {
        let _ = self.hub.events.send(Event::Left(self.id));
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.leave();
        self.hub.clients.fetch_sub(1, Ordering::AcqRel);
    }
}

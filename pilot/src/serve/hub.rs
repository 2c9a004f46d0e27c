//! The clients of the control loop: bounded queues out, one pending request each in.

use super::protocol::Request;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::time::Duration;

/// Most clients at a time.
pub const MAX_CLIENTS: usize = 64;
/// Messages that a client may be behind before it is dropped: 12 s of frames.
const QUEUE: usize = 512;

/// Identifies a client.
pub type ClientId = usize;

/// What clients do, in the order in which the control loop handles it.
pub enum Event {
    /// A client has been accepted.
    Joined(Client),
    /// A client asks for something.
    Asked(ClientId, Request),
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
    queue: SyncSender<Arc<str>>,
    pending: Arc<AtomicBool>,
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
        self.pending.store(false, Ordering::Release);
    }
}

/// Where clients join. Clones lead to the same control loop.
#[derive(Clone)]
pub struct Hub {
    events: Sender<Event>,
    clients: Arc<AtomicUsize>,
    next: Arc<AtomicUsize>,
}

impl Hub {
    /// A hub, and the events for the control loop.
    pub fn new() -> (Self, Receiver<Event>) {
        let (events, receiver) = mpsc::channel();
        let (clients, next) = (Arc::default(), Arc::default());
        let hub = Self {
            events,
            clients,
            next,
        };
        (hub, receiver)
    }

    /// A place for one more client, if there is one.
    pub fn admit(&self) -> Option<Port> {
        let place = |count| (count < MAX_CLIENTS).then_some(count + 1);
        let (done, missed) = (Ordering::AcqRel, Ordering::Acquire);
        self.clients.fetch_update(done, missed, place).ok()?;
        let (queue, messages) = mpsc::sync_channel(QUEUE);
        Some(Port {
            id: self.next.fetch_add(1, Ordering::Relaxed),
            hub: self.clone(),
            queue: Some(queue),
            messages,
            pending: Arc::default(),
        })
    }
}

/// A client's own end.
pub struct Port {
    id: ClientId,
    hub: Hub,
    queue: Option<SyncSender<Arc<str>>>,
    messages: Receiver<Arc<str>>,
    pending: Arc<AtomicBool>,
}

impl Port {
    /// Joins under this name; the reply is queued.
    pub fn join(&mut self, name: String) {
        if let Some(queue) = self.queue.take() {
            self.pending.store(true, Ordering::Release);
            let pending = Arc::clone(&self.pending);
            let (id, every, tiles) = (self.id, None, 0);
            let client = Client {
                id,
                name,
                every,
                tiles,
                queue,
                pending,
            };
            let _ = self.hub.events.send(Event::Joined(client));
        }
    }

    /// Passes a request on. While [`Self::is_pending`], a client waits.
    pub fn ask(&self, request: Request) {
        self.pending.store(true, Ordering::Release);
        let _ = self.hub.events.send(Event::Asked(self.id, request));
    }

    /// Whether a request is not answered yet.
    pub fn is_pending(&self) -> bool {
        self.pending.load(Ordering::Acquire)
    }

    /// The next message within this time, if one comes; an error once the client is dropped.
    ///
    /// # Errors
    /// The control loop has ended or has dropped this client.
    pub fn receive(&self, timeout: Duration) -> Result<Option<Arc<str>>, Dropped> {
        match self.messages.recv_timeout(timeout) {
            Ok(message) => Ok(Some(message)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Dropped),
        }
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        let _ = self.hub.events.send(Event::Left(self.id));
        self.hub.clients.fetch_sub(1, Ordering::AcqRel);
    }
}

/// The control loop has ended or has dropped the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dropped;

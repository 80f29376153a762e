//! [`SentNumbers`]: the number of the last message of each publisher. A session tells those of its publishers twice a second and
//! when a publisher ends, so that a reader can count what is lost at the end of a stream, where no later message tells of it.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Weak};

use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::{Session, Wait};

use super::lock;
use crate::transport::TransportError;

/// Most publishers whose numbers are remembered, and most that one message tells of.
const PUBLISHERS: usize = 8192;

/// What a publisher has told of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Told {
    /// The number of the last message that it has sent; messages count from 1.
    pub last: i64,
    /// Whether no more of them follow.
    pub ended: bool,
}

impl Told {
    /// Length on the wire: the global id, the number (little-endian), and 1 at the end of the publisher.
    const LEN: usize = 25;

    fn to_bytes(self, publisher: [u8; 16]) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        bytes[..16].copy_from_slice(&publisher);
        bytes[16..24].copy_from_slice(&self.last.to_le_bytes());
        bytes[24] = self.ended.into();
        bytes
    }

    fn parse(bytes: &[u8]) -> Option<([u8; 16], Self)> {
        let (publisher, rest) = bytes.split_first_chunk::<16>()?;
        let (last, ended) = rest.split_first_chunk::<8>()?;
        let told = Self { last: i64::from_le_bytes(*last), ended: ended == [1] };
        (told.last >= 0 && ended.len() == 1).then_some((*publisher, told))
    }
}

/// What was told, by the global id of the publisher.
type Table = Arc<Mutex<BTreeMap<[u8; 16], Told>>>;

pub(super) struct SentNumbers {
    /// The publishers of this session, with the number of the last message that has left each.
    own: Mutex<BTreeMap<[u8; 16], Weak<AtomicI64>>>,
    table: Table,
    /// Told with the priority of the messages, so that no number overtakes its message.
    publisher: Publisher<'static>,
    _subscriber: Subscriber<()>,
}

impl SentNumbers {
    pub fn open(session: &Session, domain: u32) -> Result<Self, TransportError> {
        let failed = |why| TransportError::new("numbers of sent messages", why);
        // Subscriptions to `**` do not match a part that begins with @.
        let key = format!("@modulo/{domain}/sent");
        let table = Table::default();
        let known = table.clone();
        let subscriber = session.declare_subscriber(format!("{key}/*")).callback(move |sample| {
            note(&mut lock(&known), &sample.payload().to_bytes());
        });
        let publisher = session
            .declare_publisher(format!("{key}/{}", session.zid()))
            .congestion_control(CongestionControl::Drop)
            .reliability(Reliability::Reliable);
        Ok(Self {
            own: Mutex::default(),
            table,
            _subscriber: subscriber.wait().map_err(failed)?,
            publisher: publisher.wait().map_err(failed)?,
        })
    }

    /// Tells of `publisher` from now on, until its counter is dropped.
    pub fn add(&self, publisher: [u8; 16], sent: &Arc<AtomicI64>) {
        lock(&self.own).insert(publisher, Arc::downgrade(sent));
    }

    /// Tells that `publisher` has ended after the message `last`.
    pub fn end(&self, publisher: [u8; 16], last: i64) {
        lock(&self.own).remove(&publisher);
        self.put(Told { last, ended: true }.to_bytes(publisher).to_vec());
    }

    /// Tells of all publishers of this session.
    pub fn tell(&self) {
        let own = lock(&self.own);
        let told = own.iter().filter_map(|(publisher, sent)| {
            let last = sent.upgrade()?.load(Ordering::Acquire);
            Some(Told { last, ended: false }.to_bytes(*publisher))
        });
        let bytes: Vec<u8> = told.flatten().collect();
        drop(own);
        if !bytes.is_empty() {
            self.put(bytes);
        }
    }

    /// Sends what is told. Where that is not possible, the session has ended, and its readers find out.
    fn put(&self, bytes: Vec<u8>) {
        let _ = self.publisher.put(bytes).wait();
    }

    /// Returns what `publisher` has told last; `None` for one that tells nothing, such as those of other programs.
    pub fn told(&self, publisher: &[u8; 16]) -> Option<Told> {
        lock(&self.table).get(publisher).copied()
    }
}

/// Adds what a message tells to `table`.
fn note(table: &mut BTreeMap<[u8; 16], Told>, bytes: &[u8]) {
    for (publisher, told) in bytes.chunks(Told::LEN).take(PUBLISHERS).filter_map(Told::parse) {
        if table.len() >= PUBLISHERS && !table.contains_key(&publisher) {
            // Any may go: one that still sends tells again.
            table.pop_first();
        }
        table.insert(publisher, told);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_bounded_number_of_publishers_is_remembered() {
        let mut table = BTreeMap::new();
        for publisher in 0..2 * PUBLISHERS as u128 {
            note(&mut table, &Told { last: 7, ended: false }.to_bytes(publisher.to_be_bytes()));
        }
        assert_eq!(table.len(), PUBLISHERS);
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            let mut table = BTreeMap::new();
            note(&mut table, &bytes);
            prop_assert!(table.values().all(|told| told.last >= 0));
        }

        #[test]
        fn what_is_told_is_understood(publisher: [u8; 16], last in 0i64.., ended: bool) {
            let told = Told { last, ended };
            prop_assert_eq!(Told::parse(&told.to_bytes(publisher)), Some((publisher, told)));
        }
    }
}

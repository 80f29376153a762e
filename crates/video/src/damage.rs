//! [`Damage`]: which packet each frame is of, and which frames are damaged, by what ffmpeg reports while it decodes.
//!
//! A report of a decoder is about the packet that it takes at that moment, whose frame may be shown after later ones. So packets are counted
//! as they are read, and a frame is of the packet with its time and place. From a damaged packet on, all frames are damaged up to a key
//! frame of a later packet: they may be predicted from what the decoder hides.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use crate::program::numbers;

/// A packet of a container, or of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Packet {
    /// Time of presentation on the time base of the stream.
    pub pts: Option<i64>,
    /// Time of decoding.
    pub dts: Option<i64>,
    /// Place in the file.
    pub pos: Option<i64>,
    /// How long its frame is shown.
    pub duration: Option<i64>,
    pub is_key: bool,
    /// Whether it is decoded for others and not shown, as an edit list has it.
    pub is_hidden: bool,
    /// Whether another recording begins with it, whose frames cannot be predicted from those before.
    pub is_joint: bool,
    /// Whether the file ends within it.
    pub is_cut: bool,
}

/// A frame as a decoder gives it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shown {
    pub pts: Option<i64>,
    /// Place of its packet; versions of ffmpeg from 7 on do not tell it.
    pub pos: Option<i64>,
    pub is_key: bool,
    /// Whether it may be predicted from other frames.
    pub is_predicted: bool,
}

/// Packets that a decoder keeps back at most, by H.264 and HEVC, and the one that it gives.
const KEPT_BACK: u64 = 17;
/// Packets that wait between the threads of ffmpeg from version 6 on.
const QUEUED: u64 = 16;
/// Damaged spans that are told apart.
const MOST: usize = 64;

/// The state of a decoder.
#[derive(Debug, Default)]
pub(crate) struct Damage {
    /// The packets that are known beforehand, in the order of decoding.
    known: Arc<[Packet]>,
    /// Packets that may have been read and not decoded.
    queued: u64,
    /// Packets that were read.
    read: u64,
    /// Packets that are decoded for certain.
    decoded: u64,
    /// Packets that were read and whose frames were not shown, with their numbers.
    waiting: VecDeque<(u64, Packet)>,
    /// Whether a frame was decoded that all others may be predicted from.
    has_begun: bool,
    /// Each damaged packet, and the first one behind the damage: frames are damaged from the former up to a key frame from the latter on.
    spans: Vec<(u64, u64)>,
    /// Packets that are not read yet, of which the container has reported damage.
    marked: BTreeSet<u64>,
    /// Whether the next frame of the decoder is reported as a corrupt one.
    is_next: bool,
}

impl Damage {
    /// Begins with the packets that are `known` beforehand, of which the first one is decoded first. A decoder that `has_begun` gives no frame
    /// before one that all others may be predicted from. `version` is that of ffmpeg.
    pub fn new(known: Arc<[Packet]>, version: &str, has_begun: bool) -> Self {
        let queued = if numbers(version) < (6, 0) { 0 } else { QUEUED };
        Self { known, queued, has_begun, ..Self::default() }
    }

    /// Takes a packet that is read, and those before it of which nothing was said.
    pub fn read(&mut self, pts: Option<i64>) {
        let is_it = |number: &u64| self.known(*number).is_none_or(|packet| packet.pts == pts);
        let own = (self.read..=self.read + self.queued).find(is_it).unwrap_or(self.read);
        for number in self.read..=own {
            let packet = self.known(number).unwrap_or(Packet { pts, ..Packet::default() });
            if packet.is_joint {
                self.lose(number, number);
            }
            if self.marked.remove(&number) || packet.is_cut {
                self.lose(number, number + 1);
            }
            self.waiting.push_back((number, packet));
        }
        self.read = own + 1;
        while self.waiting.len() as u64 > 2 * (KEPT_BACK + self.queued) {
            self.waiting.pop_front();
        }
    }

    /// Takes a report of the container that a packet with this time of decoding is damaged. It may come long before the packet is read.
    pub fn find(&mut self, dts: i64) {
        let from = usize::try_from(self.read).unwrap_or(usize::MAX).saturating_sub(1);
        let found = (from..self.known.len()).filter_map(|at| self.damaged_by(at, dts));
        let found: Vec<_> = if self.read > 0 { found.take(1).collect() } else { found.collect() };
        // The end of a recording is damaged for what joins it to the next one, which may have the same times.
        let is_end = |last: &u64| self.known(last + 1).is_some_and(|next| next.is_joint);
        let only_ends = found.iter().any(|(_, last)| is_end(last));
        let found = found.iter().filter(|(_, last)| !only_ends || is_end(last));
        self.marked =
            found.flat_map(|(first, last)| *first..=*last).chain(self.marked.iter().copied()).collect();
        if self.read.checked_sub(1).is_some_and(|last| self.marked.remove(&last)) {
            self.lose_read();
        }
    }

    /// Returns the first and the last packet of which a damaged one with this time of decoding may be a part, if it is no later one than the
    /// packet `at`.
    fn damaged_by(&self, at: usize, dts: i64) -> Option<(u64, u64)> {
        let (own, next, at) = (self.known[at].dts?, self.known.get(at + 1), at as u64);
        if own == dts {
            return Some((at, at));
        }
        // One that is cut to a part of a frame is added to the frame before it or behind it.
        let is_between =
            own < dts && next.is_none_or(|next| next.is_joint || next.dts.is_some_and(|next| next > dts));
        is_between.then(|| (at, if next.is_some_and(|next| !next.is_joint) { at + 1 } else { at }))
    }

    /// Takes a report that the packet which is read next is damaged, or the one behind it: the container is divided into frames with the begin
    /// of the next one, and a report passes for the frame that ends there.
    pub fn lose_next(&mut self) {
        if ![self.read, self.read + 1].iter().any(|packet| self.marked.contains(packet)) {
            self.lose(self.read, self.read + 2);
        }
    }

    fn known(&self, number: u64) -> Option<Packet> {
        self.known.get(usize::try_from(number).ok()?).copied()
    }

    /// Takes a report that the frame which is decoded next is damaged.
    pub fn lose_frame(&mut self) {
        self.is_next = true;
    }

    /// Takes a report of the container of a file about what it reads behind the last packet.
    pub fn lose_read(&mut self) {
        if let Some(last) = self.read.checked_sub(1).filter(|last| self.known(*last).is_some()) {
            self.lose(last, self.read);
        }
    }

    /// Takes a report of the decoder.
    pub fn lose_decoded(&mut self) {
        // Before the first packet it is about the search for the streams.
        if let Some(last) = self.read.checked_sub(1) {
            self.lose(last.saturating_sub(self.queued).max(self.decoded.min(last)), self.read);
        }
    }

    /// Takes a frame that the decoder gives, before it is shown.
    pub fn decoded(&mut self, pts: Option<i64>) {
        let found = self.place(pts, None).map(|place| self.waiting[place].0);
        self.decoded = self.decoded.max(found.map_or(0, |number| number + 1));
        // A frame is shown at once where nothing waits between threads, and with its place in the file.
        if self.is_next && (found.is_some() || self.queued > 0) {
            self.lose_packet(found);
        }
    }

    /// Notes that the frame which is reported as a corrupt one is of this packet.
    fn lose_packet(&mut self, packet: Option<u64>) {
        let (least, most) = self.range(packet);
        self.lose(least, most + 1);
        self.is_next = false;
    }

    /// Takes a frame that is shown. Returns the number of its packet, if that is known beforehand, and whether the frame is damaged.
    pub fn shown(&mut self, shown: Shown) -> (Option<u64>, bool) {
        let place = self.place(shown.pts, shown.pos);
        let packet = place.and_then(|place| self.waiting.remove(place)).map(|(number, _)| number);
        if self.is_next && self.queued == 0 {
            self.lose_packet(packet);
        }
        let (least, most) = self.range(packet);
        self.has_begun |= shown.is_key || !shown.is_predicted;
        if shown.is_key && !shown.is_predicted {
            self.spans.retain(|(_, behind)| least < *behind);
        }
        let is_damaged = !self.has_begun || self.spans.iter().any(|(first, _)| most >= *first);
        (packet.filter(|number| self.known(*number).is_some()), is_damaged)
    }

    /// Returns the first and the last packet that a frame may be of.
    fn range(&self, packet: Option<u64>) -> (u64, u64) {
        let any = (self.read.saturating_sub(KEPT_BACK + self.queued), self.read.saturating_sub(1));
        packet.map_or(any, |packet| (packet, packet))
    }

    /// Returns the place in `waiting` of the packet of a frame. Where times repeat, the place in the file decides, or else the order.
    fn place(&self, pts: Option<i64>, pos: Option<i64>) -> Option<usize> {
        self.waiting.iter().position(|(_, packet)| {
            let same = |a: Option<i64>, b: Option<i64>| a.zip(b).map(|(a, b)| a == b);
            // `None` where one of both is not known.
            let (time, place) = (same(packet.pts, pts), same(packet.pos, pos));
            time.or(place) == Some(true) && place != Some(false)
        })
    }

    /// Notes that frames are damaged from a packet on, up to a key frame from another one on.
    fn lose(&mut self, first: u64, behind: u64) {
        let is_full = self.spans.len() >= MOST;
        match self.spans.last_mut() {
            // No key frame lies between them, or it is given up.
            Some(last) if is_full || first <= last.1 => {
                *last = (last.0.min(first), last.1.max(behind));
            }
            _ => self.spans.push((first, behind)),
        }
    }
}

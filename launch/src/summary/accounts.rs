//! [`Account`]: what became of each message of a topic at each of its readers, also where nodes crash and inputs change.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use modulo_runtime::report::Reading;
use serde::Serialize;

use super::NodeReport;

/// The messages of one topic at one reader:
/// `sent = received + lost + before + down + elsewhere + after`, without those of `foreign`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Account {
    /// The topic.
    pub topic: String,
    /// The node that reads it.
    pub node: String,
    /// Messages that the nodes of the launch sent, or did not make because the topic had no reader while this one was down.
    pub sent: u64,
    /// Messages that came.
    pub received: u64,
    /// Messages that were lost on the way to a reader that listened.
    pub lost: u64,
    /// Messages from before the reader heard their sender.
    pub before: u64,
    /// Messages of the time in which a crash kept the reader or the sender from its work.
    pub down: u64,
    /// Messages of the time in which the reader had another input.
    pub elsewhere: u64,
    /// Messages from after the end of the reader.
    pub after: u64,
    /// Messages that came from outside of the launch: the results are not those of its own camera.
    pub foreign: u64,
}

impl Account {
    /// Returns whether a message is missing because of a crash, or came from outside.
    pub fn is_broken(&self) -> bool {
        self.down + self.foreign > 0
    }
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { topic, node, sent, received, down, foreign, .. } = self;
        if *down > 0 {
            write!(f, "lost in a crash: {down} of {sent} messages of {topic} at {node}")?;
        }
        if *foreign > 0 {
            let end = if *down > 0 { "; " } else { "" };
            let all = received + foreign;
            write!(f, "{end}not of this launch: {foreign} of {all} messages of {topic} at {node}")?;
        }
        Ok(())
    }
}

/// The lives of one node: it has one more after each crash.
type Lives<'a> = Vec<&'a NodeReport>;

/// What one life of a sender has put on a topic.
struct Stream<'a> {
    publisher: &'a str,
    sent: i64,
    /// Whether the sender had a life before.
    is_again: bool,
    crashed: bool,
}

/// Returns the account of each topic at each node that reads it from another process. A topic whose last message every late reader
/// gets is left out.
pub(super) fn accounts(reports: &[NodeReport]) -> Vec<Account> {
    let mut nodes: BTreeMap<&str, Lives<'_>> = BTreeMap::new();
    for report in reports {
        nodes.entry(&report.node).or_default().push(report);
    }
    let mut accounts = Vec::new();
    for (node, reader) in &nodes {
        let topics: BTreeSet<&str> =
            reader.iter().flat_map(|life| life.heard.keys()).map(String::as_str).collect();
        for topic in topics {
            let account = Account { topic: topic.to_owned(), node: (*node).to_owned(), ..Account::default() };
            accounts.push(account.of(reader, &streams(&nodes, topic), unmade(&nodes, topic)));
        }
    }
    accounts
}

/// Returns what the nodes have sent on `topic`.
fn streams<'a>(nodes: &BTreeMap<&str, Lives<'a>>, topic: &str) -> Vec<Stream<'a>> {
    let mut streams = Vec::new();
    for lives in nodes.values() {
        for (number, life) in lives.iter().enumerate() {
            let Some(publishers) = life.sent.get(topic) else { continue };
            for (publisher, &sent) in publishers {
                // A message is counted before it is sent, so that one which a crash keeps back is missed.
                let counted = life.published.get(topic).copied().filter(|_| publishers.len() == 1);
                let sent = i64::try_from(sent.max(counted.unwrap_or(0))).unwrap_or(i64::MAX);
                streams.push(Stream { publisher, sent, is_again: number > 0, crashed: life.running });
            }
        }
    }
    streams
}

/// Returns how many messages of `topic` were not made because it had no reader.
fn unmade(nodes: &BTreeMap<&str, Lives<'_>>, topic: &str) -> u64 {
    nodes.values().flatten().filter_map(|life| life.unwanted.get(topic)).sum()
}

impl Account {
    fn of(mut self, reader: &[&NodeReport], streams: &[Stream<'_>], unmade: u64) -> Self {
        let crashed = reader.iter().any(|life| life.running);
        for stream in streams {
            self.add(reader, stream);
        }
        reader.iter().for_each(|life| self.take_unread(life));
        // A message that was not made because the reader was down is missing as well.
        if crashed {
            self.sent += unmade;
            let is_swapped = reader.iter().any(|life| life.swapped);
            let part = if is_swapped { ELSEWHERE } else { DOWN };
            *part(&mut self) += unmade;
        }
        // A topic of which no node of the launch keeps an account comes from outside by intention.
        if !streams.is_empty() {
            let is_own = |reading: &Reading| streams.iter().any(|own| own.publisher == reading.publisher);
            let foreign = readings(reader, &self.topic).into_iter().filter(|(_, reading)| !is_own(reading));
            self.foreign = foreign.map(|(_, reading)| reading.received).sum();
        }
        self
    }

    /// Moves the messages that came, but found no room or still waited at a crash, to their parts.
    fn take_unread(&mut self, life: &NodeReport) {
        let of = |counts: &BTreeMap<String, u64>| counts.get(&self.topic).copied().unwrap_or(0);
        let heard = life.heard.get(&self.topic).into_iter().flatten();
        let (came, missing) =
            heard.fold((0, 0), |(came, missing), one| (came + one.received, missing + one.missing));
        let overflowed = of(&life.lost).saturating_sub(missing).min(self.received);
        let taken = of(&life.received) + overflowed;
        let waiting = if life.running { came.saturating_sub(taken) } else { 0 };
        let waiting = waiting.min(self.received - overflowed);
        self.received -= overflowed + waiting;
        self.lost += overflowed;
        self.down += waiting;
    }

    /// Adds what became of the messages of one `stream`.
    fn add(&mut self, reader: &[&NodeReport], stream: &Stream<'_>) {
        let mut heard = readings(reader, &self.topic);
        heard.retain(|(_, reading)| reading.publisher == stream.publisher);
        heard.sort_by_key(|(_, reading)| reading.first);
        let (mut last, mut before): (i64, Option<(usize, &Reading)>) = (0, None);
        for (life, reading) in heard {
            let hole = u64::try_from(reading.first - 1 - last).unwrap_or(0);
            let part = match before {
                None => self.part_of_begin(reader, (life, reading), stream),
                Some((_, Reading { lasted: true, .. })) => DOWN,
                Some(_) => ELSEWHERE,
            };
            *part(self) += hole;
            self.received += reading.received;
            self.lost += reading.missing;
            (last, before) = (reading.last.max(last), Some((life, reading)));
        }
        let rest = u64::try_from(stream.sent - last).unwrap_or(0);
        let part = match before {
            None if reader.iter().any(|life| life.swapped) => ELSEWHERE,
            None if stream.crashed || reader.iter().any(|life| life.running) => DOWN,
            None => BEFORE,
            Some((_, reading)) if !reading.lasted => ELSEWHERE,
            Some((life, _)) if stream.crashed || reader[life].running => DOWN,
            Some(_) => AFTER,
        };
        *part(self) += rest;
        self.sent += u64::try_from(stream.sent.max(last)).unwrap_or(0);
    }

    /// Returns why the reader has not heard the begin of `stream`, of which `first` is the first reading.
    fn part_of_begin(
        &self,
        reader: &[&NodeReport],
        (life, first): (usize, &Reading),
        stream: &Stream<'_>,
    ) -> Part {
        let mut others = readings(reader, &self.topic);
        others.retain(|(_, other)| other.publisher != first.publisher);
        let is_same =
            |other: &(usize, &Reading)| other.0 == life && other.1.subscription == first.subscription;
        let was_there = others.iter().any(is_same);
        match life {
            _ if was_there && stream.is_again => DOWN,
            0 => BEFORE,
            _ if was_there => BEFORE,
            // A life that goes on with the input of the one before, and one that has chosen it later.
            _ if others.iter().any(|(other, reading)| other + 1 == life && reading.lasted) => DOWN,
            _ if reader.iter().any(|life| life.swapped) => ELSEWHERE,
            _ => DOWN,
        }
    }
}

/// The count of the messages that did not come for a reason, apart from losses on the way.
type Part = fn(&mut Account) -> &mut u64;
const BEFORE: Part = |account| &mut account.before;
const DOWN: Part = |account| &mut account.down;
const ELSEWHERE: Part = |account| &mut account.elsewhere;
const AFTER: Part = |account| &mut account.after;

/// Returns what each life of `reader` has heard of `topic`, with the number of the life.
fn readings<'a>(reader: &[&'a NodeReport], topic: &str) -> Vec<(usize, &'a Reading)> {
    let of_life = |(life, report): (usize, &&'a NodeReport)| {
        report.heard.get(topic).into_iter().flatten().map(move |reading| (life, reading))
    };
    reader.iter().enumerate().flat_map(of_life).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TOPIC: &str = "/modulo";

    fn counts(count: u64) -> BTreeMap<String, u64> {
        [(TOPIC.to_owned(), count)].into()
    }

    fn camera(publisher: &str, sent: u64, unwanted: u64) -> NodeReport {
        NodeReport {
            published: counts(sent),
            unwanted: counts(unwanted),
            sent: [(TOPIC.to_owned(), [(publisher.to_owned(), sent)].into())].into(),
            ..NodeReport::new("/camera")
        }
    }

    /// What a life of the reader has heard: publisher, first and last number, and how many of them are missing.
    fn reader(heard: &[(&str, i64, i64, u64)]) -> NodeReport {
        let readings = heard.iter().map(|&(publisher, first, last, missing)| Reading {
            publisher: publisher.to_owned(),
            first,
            last,
            received: (last - first + 1) as u64 - missing,
            missing,
            subscription: 1,
            lasted: true,
        });
        let readings: Vec<Reading> = readings.collect();
        NodeReport {
            received: counts(readings.iter().map(|reading| reading.received).sum()),
            lost: counts(readings.iter().map(|reading| reading.missing).sum()),
            heard: [(TOPIC.to_owned(), readings)].into(),
            ..NodeReport::new("/unwrap")
        }
    }

    fn crashed(life: NodeReport) -> NodeReport {
        NodeReport { running: true, ..life }
    }

    fn of_reader(reports: &[NodeReport]) -> Account {
        let mut accounts = accounts(reports);
        assert_eq!(accounts.len(), 1);
        let account = accounts.pop().expect("one");
        let Account { sent, received, lost, before, down, elsewhere, after, .. } = account;
        assert_eq!(sent, received + lost + before + down + elsewhere + after, "{account:?}");
        account
    }

    #[test]
    fn a_reader_that_crashed_misses_what_no_life_of_it_has_heard() {
        let lives = |missing| {
            [camera("a", 290, 10), crashed(reader(&[("a", 1, 100, 0)])), reader(&[("a", 104, 290, missing)])]
        };
        let line = "lost in a crash: 13 of 300 messages of /modulo at /unwrap";
        assert_eq!(of_reader(&lives(0)).to_string(), line);
        assert_eq!((of_reader(&lives(9)).down, of_reader(&lives(9)).lost), (13, 9));
        // Of 100 messages, 2 found no room, and one waited when the node crashed.
        let life = NodeReport { received: counts(97), lost: counts(2), ..reader(&[("a", 1, 100, 0)]) };
        let account = of_reader(&[camera("a", 100, 0), crashed(life)]);
        assert_eq!((account.received, account.lost, account.down), (97, 2, 1));
        // A life that ended before it had subscribed, and one that is the last.
        let account = of_reader(&[camera("a", 20, 10), crashed(reader(&[])), reader(&[("a", 3, 20, 0)])]);
        assert_eq!((account.down, account.before), (12, 0));
        assert_eq!(of_reader(&[camera("a", 20, 0), crashed(reader(&[("a", 1, 15, 0)]))]).down, 5);
    }

    #[test]
    fn a_sender_that_crashed_has_counted_a_message_that_it_did_not_send() {
        let heard = reader(&[("a", 1, 100, 0), ("b", 1, 199, 0)]);
        let account = of_reader(&[crashed(camera("a", 101, 0)), camera("b", 199, 0), heard]);
        assert_eq!(account.to_string(), "lost in a crash: 1 of 300 messages of /modulo at /unwrap");
    }

    #[test]
    fn without_a_crash_each_message_has_another_reason() {
        let late = of_reader(&[camera("a", 300, 10), reader(&[("a", 41, 290, 3)])]);
        assert_eq!(
            (late.sent, late.before, late.lost, late.after, late.is_broken()),
            (300, 40, 3, 10, false)
        );
        let mut swapped = NodeReport { swapped: true, ..reader(&[("a", 1, 40, 0), ("a", 91, 100, 0)]) };
        swapped.heard.get_mut(TOPIC).expect("two readings")[0].lasted = false;
        let account = of_reader(&[camera("a", 130, 0), swapped]);
        assert_eq!((account.elsewhere, account.after, account.is_broken()), (50, 30, false));
    }

    /// A detector that crashed while it read another input had lost 781 of 850 messages of the first one in a crash.
    #[test]
    fn what_came_while_another_input_was_read_is_not_lost_in_a_crash() {
        let mut first = NodeReport { swapped: true, ..crashed(reader(&[("a", 1, 40, 0)])) };
        first.heard.get_mut(TOPIC).expect("a reading")[0].lasted = false;
        let account = of_reader(&[camera("a", 130, 0), first.clone(), reader(&[("a", 91, 130, 0)])]);
        assert_eq!((account.elsewhere, account.down), (50, 0));
        let account = of_reader(&[camera("a", 130, 0), first.clone()]);
        assert_eq!((account.elsewhere, account.down), (90, 0));
        // The camera has crashed as well, and its next life is read from the middle on.
        let lives = [crashed(camera("a", 60, 0)), camera("b", 90, 5), first, reader(&[("b", 81, 90, 0)])];
        let account = of_reader(&lives);
        assert_eq!((account.elsewhere, account.down), (105, 0));
    }

    /// Two suites in one domain gave one summary with the boxes of both cameras, and nothing said so.
    #[test]
    fn what_no_node_of_the_launch_has_sent_is_named() {
        let heard = reader(&[("a", 1, 30, 0), ("x", 5, 34, 0)]);
        let account = of_reader(&[camera("a", 30, 0), heard.clone()]);
        assert_eq!(account.to_string(), "not of this launch: 30 of 60 messages of /modulo at /unwrap");
        assert!(!of_reader(&[heard]).is_broken(), "a camera outside that is read by intention");
    }

    proptest! {
        /// Two lives of a sender and three of a reader, whose subscriptions begin, end and lose messages anywhere.
        #[test]
        fn the_parts_are_all_that_was_sent(
            sent in prop::array::uniform2(0u64..50),
            cuts in prop::collection::btree_set(1i64..50, 0..12),
            lives in prop::collection::vec((0usize..3, prop::bool::ANY, 0u64..3), 6),
            ends in prop::array::uniform3(prop::bool::ANY),
            waiting in 0u64..9,
        ) {
            let mut readers = [reader(&[]), reader(&[]), reader(&[])];
            let cuts: Vec<i64> = cuts.into_iter().collect();
            for (pair, (life, second, missing)) in cuts.chunks_exact(2).zip(lives) {
                let (publisher, sent) = if second { ("b", sent[1]) } else { ("a", sent[0]) };
                let (first, last) = (pair[0], pair[1].min(sent as i64));
                if first <= last {
                    let missing = missing.min((last - first) as u64);
                    let mut heard = reader(&[(publisher, first, last, missing)]).heard.remove(TOPIC).expect("one");
                    (heard[0].lasted, heard[0].subscription) = (waiting % 2 == 0, missing);
                    readers[life].heard.entry(TOPIC.to_owned()).or_default().extend(heard);
                    *readers[life].received.entry(TOPIC.to_owned()).or_default() += waiting;
                }
            }
            let readers = readers.into_iter().zip(ends).map(|(life, running)| NodeReport { running, ..life });
            let senders = [crashed(camera("a", sent[0], 0)), camera("b", sent[1], 0)];
            let reports: Vec<NodeReport> = senders.into_iter().chain(readers).collect();
            prop_assert_eq!(of_reader(&reports).sent, sent[0] + sent[1]);
        }
    }
}

//! Nodes that wait for each other, of which none would ever be ready.

use std::collections::{BTreeMap, BTreeSet};

/// Returns nodes that wait for each other in a circle, the first one again at the end; `None` if there are none. `waits` has the names of the
/// nodes, each with those that it waits for.
pub fn circle_of(waits: &BTreeMap<String, Vec<String>>) -> Option<Vec<&str>> {
    let mut waiting: BTreeSet<&str> = waits.keys().map(String::as_str).collect();
    let awaited = |waiting: &BTreeSet<&str>, node: &str| {
        waits[node].iter().map(String::as_str).find(|other| waiting.contains(other))
    };
    loop {
        let still: BTreeSet<&str> =
            waiting.iter().copied().filter(|node| awaited(&waiting, node).is_some()).collect();
        if still.len() == waiting.len() {
            break;
        }
        waiting = still;
    }
    let mut path = vec![waiting.first().copied()?];
    loop {
        let last = path[path.len() - 1];
        let next = awaited(&waiting, last).expect("each of these waits for another one of them");
        let begin = path.iter().position(|node| *node == next);
        path.push(next);
        if let Some(begin) = begin {
            return Some(path.split_off(begin));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_found_behind_nodes_that_only_wait_for_it() {
        let circle = |waits: &[(&str, &[&str])]| {
            let owned = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<String>>();
            let waits = waits.iter().map(|(node, others)| (node.to_string(), owned(others))).collect();
            circle_of(&waits).map(|circle| circle.join(" "))
        };
        assert_eq!(circle(&[("/a", &["/b", "/x"]), ("/b", &["/c"]), ("/c", &[])]), None);
        assert_eq!(circle(&[("/a", &["/a"])]).as_deref(), Some("/a /a"));
        let all: &[(&str, &[&str])] =
            &[("/a", &["/b"]), ("/b", &["/x", "/c"]), ("/c", &["/d", "/b"]), ("/d", &[])];
        assert_eq!(circle(all).as_deref(), Some("/b /c /b"));
    }
}

//! [`TopicRemaps`]: new names for the topics of a bag, which may have names that ROS 2 does not allow.

use modulo_runtime::NodeName;
use modulo_runtime::name::NameError;

/// Rules that rename topics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicRemaps(Vec<(String, String)>);

impl TopicRemaps {
    /// Takes (from, to) pairs. `from` is a name as it stands in the bag, with or without the first slash.
    ///
    /// # Errors
    /// [`NameError`] for a `to` that is no ROS name.
    pub fn new(pairs: Vec<(String, String)>) -> Result<Self, NameError> {
        let pair = |(from, to): (String, String)| Ok((absolute(&from), NodeName::default().resolve(&to)?));
        pairs.into_iter().map(pair).collect::<Result<_, _>>().map(Self)
    }

    /// Returns the name that the topic `name` of a bag has in the graph.
    ///
    /// # Errors
    /// [`NameError`] when that is no ROS name.
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        let full = absolute(name);
        match self.0.iter().find(|(from, _)| *from == full) {
            Some((_, to)) => Ok(to.clone()),
            None => NodeName::default().resolve(&full),
        }
    }
}

fn absolute(name: &str) -> String {
    if name.starts_with('/') { name.to_owned() } else { format!("/{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_ros_does_not_allow_gets_another_one() {
        let pairs = [("/a b", "/ok"), ("9c/", "d"), ("e//f", "/ok")];
        let rules = pairs.map(|(from, to)| (from.to_owned(), to.to_owned()));
        let remaps = TopicRemaps::new(rules.into()).expect("names");
        for (name, expected) in [
            ("/a b", Some("/ok")),
            ("a b", Some("/ok")),
            ("9c/", Some("/d")),
            ("/e//f", Some("/ok")),
            ("image", Some("/image")),
            ("/a b/c", None),
            ("/9c", None),
            ("", None),
        ] {
            assert_eq!(remaps.resolve(name).ok().as_deref(), expected, "{name}");
        }
        let why = TopicRemaps::new(vec![("/a".to_owned(), "/b c".to_owned())]).expect_err("no name");
        assert!(why.to_string().contains("'/b c' is not a ROS name"), "{why}");
    }
}

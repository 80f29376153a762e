//! ROS names: resolving relative and private topics, remapping.

/// Likeness in `[0, 1]` from which on a name is taken for a misspelling of another one.
const NEAR: f64 = 0.6;

/// No name in a graph has more bytes.
const LONGEST: usize = 255;

/// Returns the one of `known` that `name` is most likely a misspelling of: the most similar one, or one that only has another
/// namespace.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let last = |name: &str| name.rsplit_once('/').map(|(_, last)| last.to_owned());
    let likeness = |known: &'a str| {
        let moved = last(name).is_some_and(|last_part| last(known) == Some(last_part));
        (strsim::normalized_damerau_levenshtein(known, name).max(if moved { NEAR } else { 0.0 }), known)
    };
    // The comparison takes as long as both names are, and a peer may send any.
    let known = known.into_iter().filter(|known| name.len().max(known.len()) <= LONGEST);
    let near = known.map(likeness).filter(|(likeness, _)| *likeness >= NEAR);
    near.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, known)| known)
}

/// Returns the end of an error about the unknown `name`, which asks whether the nearest of `known` is meant; empty without one.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, known).map(|near| format!(", did you mean '{near}'?")).unwrap_or_default()
}

/// Returns the end of an error about the unknown `name`: [`did_you_mean`], and all of `known` behind `listed` where none is near.
pub fn near_or_all(name: &str, known: &[&str], listed: &str) -> String {
    match did_you_mean(name, known.iter().copied()) {
        near if near.is_empty() && !known.is_empty() => format!("{listed} {}", known.join(", ")),
        near => near,
    }
}

/// What to do where a node or topic of ROS 2 is missing.
pub const NOT_OVER_ZENOH: &str = "nodes on DDS are not seen here: start them with RMW_IMPLEMENTATION=rmw_zenoh_cpp and a router, or use \
                                  dds.launch.yaml; all need the same ROS_DOMAIN_ID";

/// The name of a node, its namespace and its remapping rules.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeName {
    /// Node name without slashes, such as `unwrap`.
    pub name: String,
    /// Namespace with a leading slash; `/` is the root namespace.
    pub namespace: String,
    /// (from, to) pairs, names as the node or the resolved graph knows them.
    pub remaps: Vec<(String, String)>,
}

/// Error: not a valid ROS name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{name}' is not a ROS name: {why}")]
pub struct NameError {
    name: String,
    why: &'static str,
}

impl NodeName {
    /// Creates a node in the root namespace without remaps.
    ///
    /// # Errors
    /// [`NameError`] when `name` is not a ROS token.
    pub fn new(name: &str, namespace: &str, remaps: &[(String, String)]) -> Result<Self, NameError> {
        check_token(name, name)?;
        let namespace = format!("/{}", namespace.trim_matches('/'));
        for token in namespace.split('/').skip(1).filter(|_| namespace != "/") {
            check_token(token, &namespace)?;
        }
        let mut node_name = Self { name: name.to_owned(), namespace, remaps: Vec::new() };
        for (from, to) in remaps {
            // Both sides are made absolute once, so that a rule fits every way to write a name.
            let pair = (node_name.expand(from)?, node_name.expand(to)?);
            node_name.remaps.push(pair);
        }
        Ok(node_name)
    }

    /// Returns `/namespace/name`.
    pub fn fully_qualified(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }

    /// Returns the absolute name of a topic or service as the graph sees it, after remapping.
    ///
    /// # Errors
    /// [`NameError`] when it is not a ROS name.
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        let full = self.expand(name)?;
        Ok(self.remaps.iter().find(|(from, _)| *from == full).map_or(full, |(_, to)| to.clone()))
    }

    fn expand(&self, name: &str) -> Result<String, NameError> {
        let base = self.namespace.trim_end_matches('/');
        let full = if name == "~" {
            self.fully_qualified()
        } else if let Some(private) = name.strip_prefix("~/") {
            format!("{base}/{}/{private}", self.name)
        } else if name.starts_with('/') {
            name.to_owned()
        } else {
            format!("{base}/{name}")
        };
        // The name is absolute, so the part before its first slash is empty.
        full.split('/').skip(1).try_for_each(|token| check_token(token, name))?;
        Ok(full)
    }
}

/// Returns whether ROS 2 hides the topic or service `name` from lists: a part of its name begins with an underscore.
pub fn is_hidden(name: &str) -> bool {
    name.split('/').any(|part| part.starts_with('_'))
}

/// Returns whether ROS 2 hides the node with this fully qualified name: its last part begins with an underscore.
pub fn is_hidden_node(name: &str) -> bool {
    name.rsplit('/').next().is_some_and(|name| name.starts_with('_'))
}

/// Returns whether `name` is an absolute ROS name, such as `/camera/image_raw`.
pub(crate) fn is_absolute(name: &str) -> bool {
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(|token| check_token(token, name).is_ok()))
}

fn check_token(token: &str, name: &str) -> Result<(), NameError> {
    let why = if token.is_empty() {
        "a part of it is empty"
    } else if token.starts_with(|c: char| c.is_ascii_digit()) {
        "no part may start with a digit"
    } else if !token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        "letters, digits and '_' are possible"
    } else {
        return Ok(());
    };
    Err(NameError { name: name.to_owned(), why })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_or_moved_name_has_a_nearest_one() {
        let known = ["/camera/image_raw", "/modulo", "/detector/detections", "/recovered"];
        for (name, near) in [
            ("/camera/imageraw", ", did you mean '/camera/image_raw'?"),
            ("/front/camera/image_raw", ", did you mean '/camera/image_raw'?"),
            ("/detections", ", did you mean '/detector/detections'?"),
            ("/recoverd", ", did you mean '/recovered'?"),
            ("/x", ""),
            ("", ""),
        ] {
            assert_eq!(did_you_mean(name, known), near, "{name}");
        }
    }

    #[test]
    fn resolves_as_ros_does() {
        let node_name =
            NodeName::new("detector", "/car", &[("recovered".into(), "/other/image".into())]).expect("valid");
        assert_eq!(node_name.resolve("modulo").as_deref(), Ok("/car/modulo"));
        assert_eq!(node_name.resolve("~/detections").as_deref(), Ok("/car/detector/detections"));
        assert_eq!(node_name.resolve("/abs/topic").as_deref(), Ok("/abs/topic"));
        assert_eq!(node_name.resolve("recovered").as_deref(), Ok("/other/image"));
        assert_eq!(node_name.fully_qualified(), "/car/detector");
        let root = NodeName::new("unwrap", "/", &[]).expect("valid");
        assert_eq!(root.resolve("modulo").as_deref(), Ok("/modulo"));
        assert_eq!(root.fully_qualified(), "/unwrap");
    }

    #[test]
    fn refuses_what_is_no_name() {
        for bad in ["", "a//b", "1st", "a b", "/", "a/", "über"] {
            assert!(NodeName::new("n", "", &[]).expect("valid").resolve(bad).is_err(), "{bad}");
        }
        assert!(NodeName::new("bad name", "", &[]).is_err());
        assert!(NodeName::new("n", "/1ns", &[]).is_err());
    }
}

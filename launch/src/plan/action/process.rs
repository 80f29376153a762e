//! Reading `node` and `executable` into the plans of their processes. Nothing is started here.

use std::path::Path;
use std::time::Duration;

use modulo_runtime::NodeName;
use modulo_runtime::yaml::ScalarType;

use super::parameter;
use crate::LaunchError;
use crate::package::SUITE;
use crate::plan::attributes::Attributes;
use crate::plan::{ExecutablePlan, NodePlan, ProcessPlan};
use crate::substitution::Piece;

/// The keys of a node beside those of a process.
pub(super) const NODE_KEYS: &[&str] = &["pkg", "exec", "namespace", "args", "ros_args", "param", "remap"];

/// The keys of a node and of an executable.
pub(super) const PROCESS_KEYS: &[&str] =
    &["name", "env", "output", "respawn", "respawn_delay", "on_exit", "sigterm_timeout", "sigkill_timeout"];

/// ROS 2's default from SIGINT to SIGTERM, and from SIGTERM to SIGKILL.
const PATIENCE: Duration = Duration::from_secs(5);

pub(super) fn executable(a: &Attributes<'_, '_>) -> Result<ExecutablePlan, LaunchError> {
    let command = words(a, "cmd")?.ok_or_else(|| a.missing("cmd"))?;
    let program = command.first().filter(|program| !program.is_empty()).cloned();
    let program = a.checked("cmd", program.ok_or("executable: cmd is empty"))?;
    let base =
        Path::new(&program).file_name().map_or(program.clone(), |name| name.to_string_lossy().into_owned());
    let process = process(a, a.text("name")?.unwrap_or(base))?;
    Ok(ExecutablePlan { command, process })
}

pub(super) fn node(a: &Attributes<'_, '_>) -> Result<NodePlan, LaunchError> {
    let (package, executable) = (a.required("pkg")?, a.required("exec")?);
    // A program of another package may choose its own name; a node of this suite has that of its executable.
    let name = a.text("name")?.or_else(|| (package == SUITE).then(|| executable.clone()));
    let label = name.clone().unwrap_or_else(|| executable.clone());
    let parameters = parameter::all(a)?;
    let scope = a.scope.cloned().unwrap_or_default();
    // As in `launch_ros`, the rules for all nodes come first. The first rule that fits is used.
    let mut remaps = scope.remaps.clone();
    remaps.extend(a.pairs("remap", ["from", "to"])?);
    let namespace = scope.joined(&a.text("namespace")?.unwrap_or_default());
    // The own name of another program is unknown here. Any valid name lets the others be checked.
    let valid = NodeName::new(name.as_deref().unwrap_or("unnamed"), &namespace, &remaps);
    a.checked("", valid.map(drop).map_err(|why| format!("node: {why}")))?;
    let (args, ros_args) = (arguments(a, "args")?, arguments(a, "ros_args")?);
    let (process, declared_at) = (process(a, label)?, (a.file.to_owned(), a.line));
    Ok(NodePlan {
        package,
        executable,
        name,
        namespace,
        parameters,
        remaps,
        args,
        ros_args,
        process,
        declared_at,
    })
}

/// ROS 2 gives a node an empty argument for an empty text.
fn arguments(a: &Attributes<'_, '_>, key: &str) -> Result<Vec<String>, LaunchError> {
    match a.item(key) {
        Some(item) if item.text() == Some("") => {
            Err(a.refuse(item.line, format!("{key}: is empty, leave it out")))
        }
        _ => Ok(words(a, key)?.unwrap_or_default()),
    }
}

fn words(a: &Attributes<'_, '_>, key: &str) -> Result<Option<Vec<String>>, LaunchError> {
    let Some(pieces) = a.pieces(key)? else { return Ok(None) };
    a.checked(key, split_words(&pieces)).map(Some)
}

fn process(a: &Attributes<'_, '_>, label: String) -> Result<ProcessPlan, LaunchError> {
    let errors_only = match a.text("output")?.as_deref() {
        None | Some("screen" | "both") => Ok(false),
        Some("log") => Ok(true),
        Some(other) => Err(format!("output = '{other}' must be screen, both or log")),
    };
    let ends_all = match a.plain("on_exit")? {
        Some(text) if text != "shutdown" => {
            let why = format!("on_exit = '{text}' must be shutdown");
            return Err(LaunchError::at(a.file, a.line_of("on_exit"), why));
        }
        on_exit => on_exit.is_some(),
    };
    let respawn = match a.text("respawn")? {
        Some(text) if ScalarType::of_plain(&text) != ScalarType::Bool => {
            Err(format!("respawn = '{text}' must be true or false"))
        }
        text => Ok(text.is_some_and(|text| ["true", "yes", "on"].contains(&&*text.to_ascii_lowercase()))),
    };
    let delay = a.seconds("respawn_delay")?.unwrap_or_default();
    Ok(ProcessPlan {
        label,
        env: a.pairs("env", ["name", "value"])?.into_iter().collect(),
        errors_only: a.checked("output", errors_only)?,
        respawn: a.checked("respawn", respawn)?.then_some(delay),
        ends_all,
        sigterm_timeout: a.seconds("sigterm_timeout")?.unwrap_or(PATIENCE),
        sigkill_timeout: a.seconds("sigkill_timeout")?.unwrap_or(PATIENCE),
    })
}

/// Splits a command line into words as a shell would, without running one: quotes group, a backslash makes the next
/// character plain, and the value of a substitution is never split. As in ROS 2, no quote spans a substitution.
fn split_words(pieces: &[Piece]) -> Result<Vec<String>, String> {
    let mut splitter = Splitter::default();
    for piece in pieces {
        match piece {
            Piece::Text(text) => splitter.text(text),
            Piece::Value(_) if splitter.quote.is_some() => {
                let why = "a quote spans a substitution; leave it out, the value is one word anyway";
                return Err(why.to_owned());
            }
            Piece::Value(value) => splitter.word.get_or_insert_default().push_str(value),
        }
    }
    splitter.finish()
}

#[derive(Default)]
struct Splitter {
    words: Vec<String>,
    word: Option<String>,
    quote: Option<char>,
}

impl Splitter {
    fn text(&mut self, text: &str) {
        let mut chars = text.chars();
        while let Some(c) = chars.next() {
            match (c, self.quote) {
                (c, Some(quote)) if c == quote => self.quote = None,
                // As in a shell, a backslash between single quotes is a plain character.
                ('\\', None | Some('"')) => self.push(chars.next().unwrap_or('\\')),
                (c @ ('\'' | '"'), None) => {
                    // A pair of quotes with nothing between is a word too, so the word begins with its quote.
                    self.quote = Some(c);
                    self.word.get_or_insert_default();
                }
                (c, None) if c.is_whitespace() => self.words.extend(self.word.take()),
                (c, _) => self.push(c),
            }
        }
    }

    fn push(&mut self, c: char) {
        self.word.get_or_insert_default().push(c);
    }

    fn finish(mut self) -> Result<Vec<String>, String> {
        if let Some(quote) = self.quote {
            return Err(format!("the quote {quote} does not end"));
        }
        self.words.extend(self.word);
        Ok(self.words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::substitution::{Surroundings, pieces};
    use proptest::prelude::*;

    fn split(text: &str) -> Result<Vec<String>, String> {
        let variables = [("v".to_owned(), "a b".to_owned())].into();
        let around = Surroundings { file: Path::new("f"), variables: &variables };
        split_words(&pieces(text, Some(&around)).map_err(|why| why.to_string())?)
    }

    #[test]
    fn splits_as_a_shell() {
        assert_eq!(
            split("sh -c 'echo \"x y\"' $(var v)z").expect("valid"),
            ["sh", "-c", "echo \"x y\"", "a bz"]
        );
        assert_eq!(split("a '' b\"c d\"e").expect("valid"), ["a", "", "bc de"]);
        assert!(split("'-p $(var v)'").is_err());
        assert!(split("  ").expect("valid").is_empty());
        assert!(split("'a").is_err());
    }

    proptest! {
        #[test]
        fn quoted_words_come_back(words in prop::collection::vec("[a-z \"]{0,6}", 0..5)) {
            let line: Vec<String> = words.iter().map(|w| format!("'{w}'")).collect();
            prop_assert_eq!(split(&line.join(" ")).expect("valid"), words);
        }
    }
}

//! Turns a `node` or `executable` action into the plan of a process. Nothing is started here.

use std::path::{Path, PathBuf};
use std::time::Duration;

use modulo_runtime::NodeName;
use modulo_runtime::embedded::locate;

use super::scope::{Scope, View, parameter_value};
use super::{ExecutablePlan, NodeParameter, NodePlan, ProcessPlan};
use crate::LaunchError;
use crate::action::{ExecutableAction, NodeAction, Parameter, ProcessAction};
use crate::attributes::Text;
use crate::package::SUITE;
use crate::substitution::{Part, SubstitutionError, Surroundings, Template};

/// ROS 2's default from SIGINT to SIGTERM, and from SIGTERM to SIGKILL.
const PATIENCE: Duration = Duration::from_secs(5);

pub(super) struct DeclarationSite<'a> {
    pub file: &'a Path,
    pub line: usize,
    pub view: View<'a>,
    pub scope: &'a Scope,
}

pub(super) fn executable(
    action: &ExecutableAction,
    site: &DeclarationSite<'_>,
) -> Result<ExecutablePlan, LaunchError> {
    let command = words(Some(&action.command), site)?;
    let Some(program) = command.first().filter(|program| !program.is_empty()) else {
        return Err(site.view.refuse(&action.command, "executable: cmd is empty"));
    };
    let name = site.view.optional(&action.process.name)?;
    let base =
        Path::new(program).file_name().map_or(program.clone(), |name| name.to_string_lossy().into_owned());
    let process = process(&action.process, name.unwrap_or(base), site)?;
    Ok(ExecutablePlan { command, process })
}

pub(super) fn node(action: &NodeAction, site: &DeclarationSite<'_>) -> Result<NodePlan, LaunchError> {
    let view = site.view;
    let package = view.string(&action.package)?;
    let executable = view.string(&action.executable)?;
    let given = view.optional(&action.process.name)?;
    // A program of another package may choose its own name; a node of this suite has that of its executable.
    let name = given.or_else(|| (package == SUITE).then(|| executable.clone()));
    let label = name.clone().unwrap_or_else(|| executable.clone());
    let parameters = own_parameters(&action.parameters, site)?;
    // As in `launch_ros`, the rules for all nodes come first. The first rule that fits is used.
    let mut remaps = site.scope.remaps.clone();
    remaps.extend(view.pairs(&action.remaps)?);
    let namespace = site.scope.joined(&view.optional(&action.namespace)?.unwrap_or_default());
    // The own name of another program is unknown here. Any valid name lets the others be checked.
    NodeName::new(name.as_deref().unwrap_or("unnamed"), &namespace, &remaps)
        .map_err(|e| LaunchError::at(site.file, site.line, format!("node: {e}")))?;
    Ok(NodePlan {
        package,
        executable,
        name,
        namespace,
        parameters,
        remaps,
        args: words(action.args.as_ref(), site)?,
        ros_args: words(action.ros_args.as_ref(), site)?,
        process: process(&action.process, label, site)?,
        declared_at: (site.file.to_owned(), site.line),
    })
}

fn own_parameters(own: &[Parameter], site: &DeclarationSite<'_>) -> Result<Vec<NodeParameter>, LaunchError> {
    let read = |parameter: &Parameter| {
        Ok(match parameter {
            Parameter::File(text) => {
                let path = PathBuf::from(site.view.string(text)?);
                let path = locate(&path).map_err(|why| site.view.refuse(text, why))?;
                if !path.is_file() {
                    let why = format!("param: from: {} is no file", path.display());
                    return Err(site.view.refuse(text, why));
                }
                NodeParameter::File(path)
            }
            Parameter::Value { name, value, kind } => {
                let shown = site.view.string(name)?;
                if shown.is_empty() || shown.contains(":=") || shown.contains(char::is_whitespace) {
                    return Err(site.view.refuse(name, format!("param: '{shown}' is no parameter name")));
                }
                NodeParameter::Value(shown, parameter_value(name, value, *kind, site.view)?)
            }
        })
    };
    own.iter().map(read).collect()
}

fn words(text: Option<&Text>, site: &DeclarationSite<'_>) -> Result<Vec<String>, LaunchError> {
    let Some(text) = text else { return Ok(Vec::new()) };
    site.view.locate(text, split_words(&text.template, &site.view.surroundings()))
}

fn process(
    action: &ProcessAction,
    label: String,
    site: &DeclarationSite<'_>,
) -> Result<ProcessPlan, LaunchError> {
    let view = site.view;
    let seconds = |key: &str, text: &Option<Text>, default: Duration| match text {
        Some(text) => view.number(key, text).map(Duration::from_secs_f64),
        None => Ok(default),
    };
    Ok(ProcessPlan {
        label,
        env: view.pairs(&action.env)?.into_iter().collect(),
        errors_only: errors_only(action.output.as_ref(), view)?,
        respawn: respawn(action, view)?,
        ends_all: action.ends_all,
        sigterm_timeout: seconds("sigterm_timeout", &action.sigterm_timeout, PATIENCE)?,
        sigkill_timeout: seconds("sigkill_timeout", &action.sigkill_timeout, PATIENCE)?,
    })
}

fn errors_only(output: Option<&Text>, view: View<'_>) -> Result<bool, LaunchError> {
    let Some(text) = output else { return Ok(false) };
    match view.string(text)?.as_str() {
        "screen" | "both" => Ok(false),
        "log" => Ok(true),
        other => Err(view.refuse(text, format!("output = '{other}' must be screen, both or log"))),
    }
}

fn respawn(action: &ProcessAction, view: View<'_>) -> Result<Option<Duration>, LaunchError> {
    let wanted = action.respawn.as_ref().map(|text| view.bool("respawn", text)).transpose()?;
    let delay = action.respawn_delay.as_ref().map(|text| view.number("respawn_delay", text)).transpose()?;
    Ok((wanted == Some(true)).then(|| Duration::from_secs_f64(delay.unwrap_or(0.0))))
}

/// Splits a command line into words as a shell would, without running one: quotes group, a backslash makes the next
/// character plain, and the value of a substitution is never split. As in ROS 2, no quote spans a substitution.
fn split_words(template: &Template, around: &Surroundings<'_>) -> Result<Vec<String>, SubstitutionError> {
    let mut splitter = Splitter::default();
    for part in &template.parts {
        match part {
            Part::Text(text) => splitter.text(text),
            Part::Call(..) if splitter.quote.is_some() => {
                let why = "a quote spans a substitution; leave it out, the value is one word anyway";
                return Err(SubstitutionError::Invalid(why.to_owned()));
            }
            Part::Call(..) => splitter.word.get_or_insert_default().push_str(&part.evaluate(around)?),
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

    fn finish(mut self) -> Result<Vec<String>, SubstitutionError> {
        if let Some(quote) = self.quote {
            return Err(SubstitutionError::Invalid(format!("the quote {quote} does not end")));
        }
        self.words.extend(self.word);
        Ok(self.words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn split(text: &str) -> Result<Vec<String>, SubstitutionError> {
        let variables = [("v".to_owned(), "a b".to_owned())].into();
        let around = Surroundings { file: std::path::Path::new("f"), variables: &variables };
        split_words(&Template::parse(text)?, &around)
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

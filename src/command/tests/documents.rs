//! Tests: every command in the documents can be run as it is written, as far as its words tell; links between them lead to files;
//! and the reference of the commands and of the launch arguments is what the program declares.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::error::ErrorKind;
use clap::{ArgMatches, CommandFactory as _};
use modulo_runtime::ros_args::RosArgs;

use super::launch::refuse;
use super::pairs;
use super::run::kind_of;
use crate::cli::{Cli, with_negative_numbers};

/// The words of each command in a line of a shell, without its comment.
fn commands(line: &str) -> Vec<Vec<String>> {
    let (mut commands, mut word, mut quote) = (vec![Vec::new()], None::<String>, None);
    for letter in line.chars() {
        match (quote, letter) {
            (Some(open), _) if open == letter => quote = None,
            (Some(_), _) => word.get_or_insert_default().push(letter),
            (None, '\'' | '"') => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (None, '#') if word.is_none() => break,
            (None, ' ' | ';' | '&' | '|' | '>') => {
                commands.last_mut().expect("there is one").extend(word.take());
                if letter != ' ' {
                    commands.push(Vec::new());
                }
            }
            (None, _) => word.get_or_insert_default().push(letter),
        }
    }
    commands.last_mut().expect("there is one").extend(word);
    commands
}

/// The arguments of a command of the suite; `None` for another program.
fn arguments(words: &[String]) -> Option<Vec<String>> {
    let first = words.iter().position(|word| !word.contains('=') || word.contains('/'))?;
    let words: Vec<&str> = words[first..].iter().map(String::as_str).collect();
    let found = match words[..] {
        ["cargo", "run", "--release", "--", ref rest @ ..] => rest.to_vec(),
        ["ros2", "launch", "modulo", ref rest @ ..] => [&["launch"], rest].concat(),
        ["ros2", "run", "modulo", ref rest @ ..] => [&["run"], rest].concat(),
        [program, ref rest @ ..] if program == "modulo" || program.ends_with("/bin/modulo") => rest.to_vec(),
        _ => return None,
    };
    Some(found.into_iter().map(str::to_owned).collect())
}

/// Why the command with these arguments is wrong. A command that is `named` in a sentence may leave arguments out.
fn fault(arguments: &[String], named: bool) -> Option<String> {
    let words = std::iter::once("modulo").chain(arguments.iter().map(String::as_str));
    match with_negative_numbers(Cli::command()).try_get_matches_from(words) {
        Ok(matches) => match matches.subcommand()? {
            ("launch" | "eval", of) => launch_fault(of),
            ("run", of) => run_fault(of),
            ("param", of) => param_fault(of.subcommand()?.1),
            _ => None,
        },
        Err(why) => match why.kind() {
            ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => None,
            ErrorKind::MissingRequiredArgument
            | ErrorKind::MissingSubcommand
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                if named =>
            {
                None
            }
            // A number is asked for, and the documents have a word in its place.
            ErrorKind::ValueValidation if arguments.iter().any(|word| is_placeholder(word)) => None,
            _ => Some(why.to_string()),
        },
    }
}

fn is_placeholder(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|letter| letter.is_ascii_uppercase())
}

fn texts(of: &ArgMatches, name: &str) -> Vec<String> {
    of.try_get_many::<String>(name).ok().flatten().into_iter().flatten().cloned().collect()
}

/// Launch files that the documents name must exist, and take the arguments.
fn launch_fault(of: &ArgMatches) -> Option<String> {
    let file = of.get_one::<PathBuf>("file").filter(|file| !is_placeholder(&file.to_string_lossy()))?;
    // In a workspace of colcon, the checkout is in its folder `src`.
    let file = file.strip_prefix("src/modulo").unwrap_or(file);
    let file = modulo_launch::launch_file(file).map_err(|why| why.to_string());
    let Ok(file) = file else { return file.err() };
    let plan = modulo_launch::resolve(&file, &pairs(&texts(of, "arguments")).ok()?);
    match plan.map(|plan| refuse(&plan)) {
        Err(why) => Some(why.to_string()),
        Ok(Err(crate::Failure::Usage(why) | crate::Failure::Run(why))) => Some(why.to_string()),
        Ok(Ok(())) => None,
    }
}

fn run_fault(of: &ArgMatches) -> Option<String> {
    let (node, words) = (of.get_one::<String>("node")?, texts(of, "arguments"));
    if node.starts_with('-') || node == "NODE" || words.iter().any(|word| word == "--params-file") {
        return None;
    }
    let fault = || -> anyhow::Result<()> {
        let (kind, (ros, _)) = (kind_of(node)?, RosArgs::parse(&words)?);
        let node_name = ros.node_name(kind.name)?;
        kind.parameters_of(&node_name)?.with_text(&ros.parameters_for(&node_name)?)?;
        Ok(())
    };
    fault().err().map(|why| format!("{why:#}"))
}

/// Parameters of the nodes with the usual names must exist.
fn param_fault(of: &ArgMatches) -> Option<String> {
    let text = |name| of.try_get_one::<String>(name).ok().flatten();
    let (node, name) = (text("node")?.rsplit('/').next()?, text("name")?);
    let declared = kind_of(node).ok()?.parameters();
    // Names with a dot depend on the name of the node.
    let unknown = !name.contains('.') && declared.descriptor(name).is_none();
    unknown.then(|| format!("{node} has no parameter {name}"))
}

/// The root of the repository.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The paths of the documents.
fn documents() -> Vec<PathBuf> {
    let book = ["tutorials", "how-to", "reference", "explanation", "research", "contributing"];
    let folders = ["", "docs", "crates/models", "nodes/ros2_bridge", "tools/train"].map(str::to_owned);
    let folders = folders.into_iter().chain(book.map(|kind| format!("docs/{kind}")));
    let entries = folders.flat_map(|folder| std::fs::read_dir(root().join(folder)).expect("a folder"));
    let paths = entries.map(|entry| entry.expect("a file").path());
    paths.filter(|path| path.extension().is_some_and(|extension| extension == "md")).collect()
}

/// A line of a table. A vertical bar would end a cell.
fn row(cells: &[&str]) -> String {
    let cells =
        cells.iter().map(|cell| cell.replace('|', "\\|").split_whitespace().collect::<Vec<_>>().join(" "));
    format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
}

/// The commands below `command`, whose words are `called`, each with a table of its options.
fn describe(command: &clap::Command, called: &str, page: &mut String) {
    let text = |text: Option<&clap::builder::StyledStr>| text.map(ToString::to_string).unwrap_or_default();
    let about = text(command.get_long_about().or(command.get_about()));
    let _ = write!(page, "\n{} {called}\n\n{about}.\n", "#".repeat(called.split(' ').count().min(3)));
    let shown = |argument: &&clap::Arg| !argument.is_hide_set() && argument.get_id() != "help";
    let arguments: Vec<_> = command.get_arguments().filter(shown).collect();
    if !arguments.is_empty() {
        page.push_str("\n| option | default | meaning |\n|---|---|---|\n");
    }
    for argument in arguments {
        let switch = !argument.get_action().takes_values();
        let default = argument
            .get_default_values()
            .iter()
            .filter(|_| !switch && !argument.is_hide_default_value_set())
            .map(|value| value.to_string_lossy());
        let default = default.collect::<Vec<_>>().join(",");
        let default = if default.is_empty() { default } else { format!("`{default}`") };
        let mut help = text(argument.get_long_help().or(argument.get_help()));
        let possible: Vec<_> = argument.get_possible_values();
        if !(switch || possible.is_empty() || argument.is_hide_possible_values_set()) {
            let possible: Vec<_> = possible.iter().map(|value| format!("`{}`", value.get_name())).collect();
            let _ = write!(help, ". One of {}", possible.join(", "));
        }
        let short = argument.get_short().map(|letter| format!("-{letter}, ")).unwrap_or_default();
        page.push_str(&row(&[&format!("`{short}{argument}`"), &default, &help]));
    }
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        describe(below, &format!("{called} {}", below.get_name()), page);
    }
}

/// The launch files, and their arguments with the files that have each of them with this default and description.
fn launch_arguments() -> String {
    let (mut page, mut rows) =
        ("\n| file | content |\n|---|---|\n".to_owned(), Vec::<([String; 3], Vec<String>)>::new());
    let files = modulo_launch::launch_files().expect("those of the suite");
    for file in &files {
        page.push_str(&row(&[&format!("`{}`", file.name), &file.about]));
        for argument in modulo_launch::declared_arguments(&file.path).expect("a launch file of the suite") {
            let default = argument.default.map_or("required".to_owned(), |text| shown_default(&text));
            let mut help = argument.description.unwrap_or_default();
            if !argument.choices.is_empty() {
                let _ = write!(help, ". One of `{}`", argument.choices.join("`, `"));
            }
            let cells = [format!("`{}`", argument.name), help, default];
            match rows.iter_mut().find(|(other, _)| *other == cells) {
                Some((_, files)) => files.push(file.name.clone()),
                None => rows.push((cells, vec![file.name.clone()])),
            }
        }
    }
    rows.sort_by(|(one, _), (other, _)| one[0].cmp(&other[0]));
    page.push_str("\n| argument | meaning | default | files |\n|---|---|---|---|\n");
    for ([name, help, default], having) in rows {
        let others: Vec<&str> = files
            .iter()
            .map(|file| &*file.name)
            .filter(|name| !having.iter().any(|file| file == name))
            .collect();
        let which = match others.len() {
            0 => "all".to_owned(),
            count if count < having.len() => format!("all but {}", others.join(", ")),
            _ => having.join(", "),
        };
        page.push_str(&row(&[&name, &help, &default, &which]));
    }
    page
}

/// Returns the default of an argument as a reader needs it: both values of one that depends on another argument.
fn shown_default(text: &str) -> String {
    let choice = text.strip_prefix("$(if $(var ").and_then(|rest| rest.strip_suffix(')')?.split_once(") "));
    match choice.and_then(|(name, values)| Some((name, values.split_once(' ')?))) {
        Some((name, (set, not))) => format!("`'{set}'`, with {name}:=false `'{not}'`"),
        None => format!("`'{text}'`"),
    }
}

#[test]
fn the_reference_is_what_the_program_declares() {
    let rewrite = "MODULO_REWRITE=1 cargo test --bin modulo documents";
    let mut commands = String::new();
    let mut command = Cli::command();
    command.build();
    describe(&command, "modulo", &mut commands);
    let commands = commands.replacen("\n# modulo\n", "", 1);
    for (name, title, text) in
        [("cli.md", "Commands", commands), ("launch-arguments.md", "Launch arguments", launch_arguments())]
    {
        let page = format!("# {title}\n\n<!-- Made from the declarations by {rewrite}. -->\n{text}");
        let file = root().join("docs/reference").join(name);
        if std::env::var_os("MODULO_REWRITE").is_some() {
            std::fs::write(&file, &page).expect("writable");
        }
        let written = std::fs::read_to_string(&file).unwrap_or_default();
        assert!(
            written == page,
            "{} is not what the program declares; {rewrite} writes it anew",
            file.display()
        );
    }
}

#[test]
fn links_in_the_documents_lead_to_files() {
    let mut faults = Vec::new();
    for path in documents() {
        let text = std::fs::read_to_string(&path).expect("readable");
        for link in text.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next()) {
            let target = link.split('#').next().unwrap_or_default();
            let outside = target.contains("://") || target.starts_with("mailto:");
            if !outside && !path.with_file_name(target).exists() && !target.is_empty() {
                faults.push(format!("{}: {link}", path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn every_command_in_the_documents_can_be_run() {
    let (mut faults, mut count) = (Vec::new(), 0);
    for path in documents() {
        let text = std::fs::read_to_string(&path).expect("readable").replace("\\\n", "  ");
        for (index, block) in text.split("```").enumerate() {
            let shell = index % 2 == 1 && (block.starts_with("sh\n") || block.starts_with("bash\n"));
            let lines: Vec<&str> = match index % 2 {
                0 => block.split('`').skip(1).step_by(2).collect(),
                _ if shell => block.lines().skip(1).collect(),
                _ => continue,
            };
            for line in lines {
                let line = line.split_whitespace().collect::<Vec<_>>().join(" ");
                for arguments in commands(&line).iter().filter_map(|words| arguments(words)) {
                    count += 1;
                    if let Some(why) = fault(&arguments, !shell) {
                        faults.push(format!("{}: {line}\n    {why}", path.display()));
                    }
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(count > 150, "only {count} commands were found");
}

/// The node, the launch files, `modulo simulate` and `modulo eval` simulate one sensor where nothing is set.
#[test]
fn the_sensor_is_the_same_by_default_everywhere() {
    let file = modulo_launch::launch_file("recovered".as_ref()).expect("a launch file");
    let plan = modulo_launch::resolve(&file, &[]).expect("possible");
    let node = plan.nodes.iter().find(|node| node.executable == "modulo_camera").expect("the camera");
    let (ros, _) = RosArgs::parse(&modulo_launch::ros_arguments(node)).expect("possible");
    let launched = ros.parameters_for(&ros.node_name("modulo_camera").expect("a name")).expect("readable");
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let cli = Cli::command();
    let option = |command: &str, name: &str| {
        let command = cli.find_subcommand(command).expect("a command");
        let option = command.get_arguments().find(|option| option.get_id() == name).expect("an option");
        number(&option.get_default_values().first().expect("a default").to_string_lossy())
    };
    let parameters = kind_of("modulo_camera").expect("a node").parameters();
    for (name, commands) in [
        ("alpha", &["simulate"][..]),
        ("headroom", &["simulate", "eval"]),
        ("optical_black", &["simulate", "eval"]),
        ("psf_sigma", &["simulate", "eval"]),
    ] {
        let default = number(&parameters.get(name).expect("declared").plain());
        let (_, text) =
            launched.iter().rfind(|(other, _)| other == name).expect("an argument of the launch file");
        assert_eq!(number(text), default, "{name} of the launch file");
        commands.iter().for_each(|command| assert_eq!(option(command, name), default, "{name} of {command}"));
    }
    // Images of a sensor that somebody else has built have no such columns and no such lens.
    assert_eq!(["optical_black", "psf_sigma"].map(|name| option("unwrap", name)), [0.0; 2]);
}

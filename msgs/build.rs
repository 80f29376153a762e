//! Makes the structs of the messages from their definitions in `interfaces/`, a file for each ROS package, and the table of the
//! definitions. Comments become documentation: those before a blank line belong to the message, others to the line behind them.
//!
//! It only reads what these files have, which the tests of the crate compare with what `definition.rs` reads.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{env, fs};

/// A message, or the request or the response of a service.
struct Message {
    ros_name: String,
    docs: String,
    lines: Vec<Line>,
}

/// A field or a constant.
struct Line {
    docs: String,
    kind: String,
    name: String,
    /// `=` and the value of a constant, or the default of a field.
    value: String,
}

/// By package and name in Rust, such as `std_srvs/SetBoolRequest`.
type Messages = BTreeMap<String, Message>;

fn main() {
    println!("cargo::rerun-if-changed=interfaces");
    println!("cargo::rerun-if-changed=build.rs");
    let (mut messages, mut definitions) = (Messages::new(), String::new());
    for file in sorted("interfaces".as_ref())
        .iter()
        .flat_map(|package| sorted(package))
        .flat_map(|kind| sorted(&kind))
    {
        let name = file.strip_prefix("interfaces").expect("it was listed there").with_extension("");
        let name = name.to_str().expect("ROS names are ASCII");
        let text = fs::read_to_string(&file).expect("a definition is a text");
        // Bags and type descriptions carry the definition as it is hashed.
        let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
        let bare: String = lines.map(|line| format!("{line}\n")).collect();
        definitions += &format!("({name:?}, {bare:?}),\n");
        add(&mut messages, name, &text);
    }
    write("definitions.rs", &format!("&[\n{definitions}]"));
    let packages: BTreeSet<&str> = messages.keys().map(|key| split(key).0).collect();
    packages.iter().for_each(|package| write(&format!("{package}.rs"), &package_code(&messages, package)));
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("the folders of the definitions are there");
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("it is readable").path()).collect();
    paths.sort();
    paths
}

fn write(file: &str, code: &str) {
    let folder = env::var_os("OUT_DIR").expect("cargo names the folder");
    fs::write(Path::new(&folder).join(file), code).expect("cargo has made the folder");
}

fn split(name: &str) -> (&str, &str) {
    name.split_once('/').expect("a name has a package")
}

/// Adds the message `name`, or the request and the response of the service `name`.
fn add(messages: &mut Messages, name: &str, text: &str) {
    let (package, path) = split(name);
    let (kind, last) = split(path);
    let suffixes: &[&str] = if kind == "srv" { &["Request", "Response"] } else { &[""] };
    for (suffix, text) in suffixes.iter().zip(text.split("---\n")) {
        let separator = if suffix.is_empty() { "" } else { "_" };
        let mut message = Message {
            ros_name: format!("{name}{separator}{suffix}"),
            docs: String::new(),
            lines: Vec::new(),
        };
        let mut docs = String::new();
        for line in text.lines() {
            if line.is_empty() {
                message.docs = std::mem::take(&mut docs);
            } else if let Some(comment) = line.strip_prefix('#') {
                docs += &format!("{comment}\n");
            } else {
                let (kind, rest) = line.split_once(' ').expect("a type and a name");
                let end = rest.find([' ', '=']).unwrap_or(rest.len());
                let (name, value) = (rest[..end].to_owned(), rest[end..].trim().to_owned());
                let (docs, kind) = (std::mem::take(&mut docs), kind.to_owned());
                message.lines.push(Line { docs, kind, name, value });
            }
        }
        // ROS gives a message without fields one byte, since an empty struct is not possible in C.
        if message.fields().next().is_none() {
            let (kind, name) = ("uint8".to_owned(), "structure_needs_at_least_one_member".to_owned());
            message.lines.push(Line { docs, kind, name, value: String::new() });
        }
        messages.insert(format!("{package}/{last}{suffix}"), message);
    }
}

impl Message {
    fn fields(&self) -> impl Iterator<Item = &Line> {
        self.lines.iter().filter(|line| !line.value.starts_with('='))
    }
}

/// Returns the key of the message that a field of a message in `package` holds, if it holds one.
fn nested(package: &str, kind: &str) -> Option<String> {
    let element = kind.split('[').next()?;
    let name = if element.contains('/') { element.to_owned() } else { format!("{package}/{element}") };
    split(&name).1.starts_with(char::is_uppercase).then_some(name)
}

/// Returns whether all fields of the message `key`, and of those within it, pass `test`.
fn all(messages: &Messages, key: &str, test: fn(&str) -> bool) -> bool {
    let inner = |kind| nested(split(key).0, kind).is_none_or(|inner| all(messages, &inner, test));
    messages[key].fields().all(|field| test(&field.kind) && inner(&field.kind))
}

/// Returns whether a field of the type `kind` has the same size in each message.
fn is_sized(kind: &str) -> bool {
    !kind.starts_with("string") && !kind.contains("[]") && !kind.contains("[<=")
}

/// Returns the content of the module `package`, which also has the types of other packages that its messages hold.
fn package_code(messages: &Messages, package: &str) -> String {
    let own = || messages.iter().filter(|(key, _)| split(key).0 == package);
    let needed: BTreeSet<_> = own()
        .flat_map(|(_, message)| message.fields())
        .filter_map(|field| nested(package, &field.kind))
        .collect();
    let foreign = needed.iter().filter(|key| split(key).0 != package);
    let uses = foreign.map(|key| format!("pub use crate::{};\n", key.replace('/', "::")));
    uses.chain(own().map(|(key, message)| message_code(messages, key, message))).collect()
}

fn message_code(messages: &Messages, key: &str, message: &Message) -> String {
    let (ros_name, name) = (&message.ros_name, split(key).1);
    let about = docs(&format!("`{ros_name}`\n\n{}", message.docs));
    let default = |field: &Line| match field.value.as_str() {
        "" => "::std::default::Default::default()".to_owned(),
        value => value.to_owned(),
    };
    let has_default = message.fields().any(|field| !["", "0.0", "false"].contains(&&*field.value));
    let traits = [
        (true, "Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize"),
        (!has_default, "Default"),
        (all(messages, key, is_sized), "Copy"),
        (all(messages, key, |kind| !kind.starts_with("float")), "Eq, Hash"),
    ];
    let traits: Vec<_> = traits.iter().filter(|(has, _)| *has).map(|(_, name)| *name).collect();
    let fields: String = message.fields().map(field_code).collect();
    let constants = message.lines.iter().filter_map(|line| {
        let value = line.value.strip_prefix('=')?;
        Some(format!("{}pub const {}: {} = {value};\n", docs(&line.docs), line.name, rust_type(&line.kind)))
    });
    let mut code = format!(
        "{about}#[derive({})]\npub struct {name} {{\n{fields}}}\n\
         impl crate::Interface for {name} {{ const NAME: &'static str = {ros_name:?}; }}\n",
        traits.join(", ")
    );
    let constants: String = constants.collect();
    if !constants.is_empty() {
        code += &format!("impl {name} {{\n{constants}}}\n");
    }
    if has_default {
        let fields: String =
            message.fields().map(|field| format!("{}: {}, ", field.name, default(field))).collect();
        code += &format!("impl Default for {name} {{ fn default() -> Self {{ Self {{ {fields}}} }} }}\n");
    }
    code
}

fn field_code(field: &Line) -> String {
    let kind = rust_type(&field.kind);
    // One copy in place of a call for each byte makes messages of images cheap.
    let serde = if kind == "Vec<u8>" { "#[serde(with = \"crate::cdr::bytes\")] " } else { "" };
    let raw = if field.name == "type" { "r#" } else { "" };
    format!("{}{serde}pub {raw}{}: {kind},\n", docs(&field.docs), field.name)
}

fn docs(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("#[doc = {text:?}]\n") }
}

/// Returns the type in Rust of a field of the type `kind`.
fn rust_type(kind: &str) -> String {
    let (element, many) = kind.split_once('[').unwrap_or((kind, ""));
    let last = element.rsplit('/').next().unwrap_or(element);
    let element = match last {
        "byte" | "char" => "u8".to_owned(),
        // A package may have a message of this name.
        text if text.starts_with("string") => "::std::string::String".to_owned(),
        number => number.replace("uint", "u").replace("int", "i").replace("float", "f"),
    };
    let element = if last.starts_with(char::is_uppercase) { last.to_owned() } else { element };
    match many.trim_end_matches(']').parse::<usize>() {
        // Arrays of arrays have the same form on the wire, and serde knows arrays of at most 32 elements.
        Ok(length) if length > 32 => format!("[[{element}; 6]; {}]", length / 6),
        Ok(length) => format!("[{element}; {length}]"),
        Err(_) if many.is_empty() => element,
        Err(_) => format!("Vec<{element}>"),
    }
}

//! Every mistake is named with its line and with what is possible.

use crate::Files;

/// (actions below `launch:`, how the message begins)
const MISTAKES: &[(&str, &str)] = &[
    ("- noed: {}", "2: action 'noed' is not supported, supported are arg, group"),
    (
        "- node:\n    pkg: p\n    exec: e\n    paramz: []",
        "5: node: key 'paramz' is not supported, supported are pkg, exec",
    ),
    ("- node:\n    pkg: p", "2: node: key 'exec' is missing"),
    ("- set_remap: { from: x }", "2: set_remap: key 'to' is missing"),
    ("- include: {}", "2: include: key 'file' is missing"),
    ("- timer: { period: 1.0, children: [] }", "2: action 'timer' is not supported, supported are arg"),
    ("- node: [a]", "2: node: expected a mapping of attributes, found a list"),
    ("- group", "2: expected one action '- name: attributes', found the string 'group'"),
    ("- arg: { name: x }\n  group: []", "2: expected one action"),
    (
        "- set_remap: { from: x, to: 4.0 }",
        "2: set_remap: to: expected a string, found the number 4.0, write \"4.0\"",
    ),
    (
        "- executable: { cmd: yes }",
        "2: executable: cmd: expected a string, found the bool yes, write \"yes\"",
    ),
    ("- executable: { cmd: }", "2: executable: cmd: expected a string, found nothing"),
    ("- group: { if: true }", "2: group: if: expected a string, found the bool true, write \"true\""),
    (
        "- group: { scoped: false }",
        "2: group: key 'scoped' is not supported, supported are children, if, unless",
    ),
    ("- group: { children: a }", "2: group: children: expected a list, found the string 'a'"),
    ("- executable:\n    cmd: \"$(var nope)\"", "3: undefined variable 'nope', defined here are none"),
    (
        "- executable: { cmd: \"$(eval '1')\" }",
        "2: executable: cmd: $(eval) is not supported, supported are var",
    ),
    ("- executable: { cmd: \"$(var x\" }", "2: executable: cmd: '$(var x': a substitution does not end"),
    ("- group: { if: maybe }", "2: if: 'maybe' is not a condition; use true, false, 1 or 0"),
    ("- group: { if: '1', unless: '1' }", "2: group: 'if' and 'unless' exclude each other"),
    ("- arg: { name: x }", "2: argument 'x' has no value and no default, give x:=VALUE"),
    (
        "- arg:\n    name: x\n    default: c\n    choice: [{ value: a }, { value: b }]",
        "3: argument 'x' = 'c' must be one of a, b",
    ),
    ("- arg: { name: x, choice: [a] }", "2: choice: expected a mapping of attributes, found the string 'a'"),
    ("- include: { file: $(dirname)/none.launch.yaml }", "2: include: none.launch.yaml: No such file"),
    ("- include: { file: $(dirname)/demo.launch.py }", "2: include: 'demo.launch.py' is not YAML"),
    ("- include: { file: $(dirname)/main.launch.yaml }", "2: include: main.launch.yaml includes itself"),
    (
        "- include: { file: none.launch.yaml }",
        "2: include: 'none.launch.yaml' starts at any working folder, write $(dirname)/none.launch.yaml",
    ),
    (
        "- node: { pkg: p, exec: e, launch-prefix: gdb }",
        "2: node: key 'launch-prefix' is not supported, supported are pkg, exec",
    ),
    (
        "- arg: { name: x, default: '' }\n- node: { pkg: p, exec: e, param: [{ name: a, value: $(var x) }] }",
        "3: parameter 'a' = '' is neither a scalar nor a list to ROS 2, give it type: \"str\"",
    ),
    ("- executable: { cmd: costs 5 $ }", "2: executable: cmd: 'costs 5 $': a dollar without '('"),
    ("- arg: { name: $(var x) }", "2: arg: name: ROS 2 evaluates no substitution here"),
    ("- executable: { cmd: 010 }", "2: YAML readers disagree on 010; write \"010\" for text"),
    ("- executable: { cmd: '' }", "2: executable: cmd is empty"),
    ("- executable: { cmd: \"a 'b\" }", "2: the quote ' does not end"),
];

/// (attributes of a node in line 2, how the message begins)
const NODE_MISTAKES: &[(&str, &str)] = &[
    ("name: 1st", "node: '1st' is not a ROS name"),
    ("namespace: a b", "node: '/a b' is not a ROS name"),
    ("remap: [{ from: a }]", "remap: key 'to' is missing"),
    ("output: printer", "output = 'printer' must be screen, both or log"),
    ("on_exit: restart", "on_exit = 'restart' must be shutdown"),
    ("respawn: true", "node: respawn: expected a string, found the bool true, write \"true\""),
    (
        "sigterm_timeout: '1.5'",
        "node: sigterm_timeout: expected a number, found the string '1.5', write 1.5 without quotes",
    ),
    ("on_exit: $(var x)", "node: on_exit: ROS 2 evaluates no substitution here"),
    ("args: ''", "node: args: is empty, leave it out"),
    ("respawn: often", "respawn = 'often' must be true or false"),
    ("param: []", "node: param: the list is empty, leave it out"),
];

/// (attributes of a parameter in line 2, how the message begins)
const PARAMETER_MISTAKES: &[(&str, &str)] = &[
    ("name: a", "param: key 'value' is missing"),
    ("value: 1", "param: key 'name' is missing"),
    ("from: no.yaml", "param: from: no.yaml is no file"),
    ("from: f, name: a", "param: 'from' must be the only key"),
    ("name: a, value: { b: 1 }", "param: value: expected a value"),
    ("name: a, value: x, type: int", "param: value: the string 'x' must be of type int"),
    ("name: a, value: [1], type: int", "param: value: is a list, must be of type int"),
    ("name: a, value: 4, type: float", "param: value: the integer 4 must be of type float"),
    ("name: a, value: [1, 2.0]", "param: value: the number 2.0 must be of type int as the first in its list"),
    ("name: a, value: []", "param: value: an empty list has no type for ROS 2"),
    ("name: a, value: 1, type: long", "param: type: unknown 'long', known are int, float"),
];

fn assert_refused(actions: &str, message: &str) {
    let text: String = actions.lines().map(|line| format!("  {line}\n")).collect();
    let refusal = Files::new(&format!("launch:\n{text}")).refusal(&[]);
    assert!(refusal.starts_with(&format!("main.launch.yaml:{message}")), "{actions}\n{refusal}");
    assert_eq!(refusal.lines().count(), 1, "{refusal}");
}

#[test]
fn mistakes_are_named_with_their_line() {
    MISTAKES.iter().for_each(|(actions, message)| assert_refused(actions, message));
    let node = |attributes: &str| format!("- node: {{ pkg: p, exec: e, {attributes} }}");
    for (attributes, message) in NODE_MISTAKES {
        assert_refused(&node(attributes), &format!("2: {message}"));
    }
    for (attributes, message) in PARAMETER_MISTAKES {
        assert_refused(&node(&format!("param: [{{ {attributes} }}]")), &format!("2: {message}"));
    }
}

#[test]
fn a_file_that_is_no_launch_file_is_refused() {
    for (text, message) in [
        ("", "main.launch.yaml:1: is empty"),
        ("launch: 3\n", "main.launch.yaml:1: launch file: launch: expected a list, found the integer 3"),
        (
            "lunch: []\n",
            "main.launch.yaml:1: launch file: key 'lunch' is not supported, supported are launch",
        ),
        ("- a\n", "main.launch.yaml:1: launch file: expected a mapping"),
        ("launch: [\n", "main.launch.yaml:"),
    ] {
        let refusal = Files::new(text).refusal(&[]);
        assert!(refusal.starts_with(message), "{refusal}");
    }
}

#[test]
fn a_launch_file_in_another_language_is_named() {
    let files = Files::new("<launch>\n  <node pkg=\"p\" exec=\"e\"/>\n</launch>\n")
        .with("a.launch.py", "def generate_launch_description():\n    pass\n");
    assert!(files.refusal(&[]).contains("ROS 2 knows launch files in XML, but only YAML is supported here"));
    let python = modulo_launch::resolve(&files.path("a.launch.py"), &[]).expect_err("is Python");
    assert!(python.to_string().contains("ROS 2 knows launch files in Python"), "{python}");
}

/// A pipe would keep its reader for ever, and a device has no end.
#[test]
fn what_is_no_regular_file_is_refused() {
    for special in ["/dev/zero", "/tmp"] {
        let why = modulo_launch::resolve(std::path::Path::new(special), &[]).expect_err("special");
        assert!(why.to_string().contains("is not a regular file"), "{why}");
    }
}

#[test]
fn a_mistake_has_the_line_of_its_own_file() {
    let include = "launch:\n  - include: { file: $(dirname)/b.launch.yaml }\n";
    for (main, included, message) in [
        // In a branch that is not taken.
        (
            "launch:\n  - group:\n      if: 'false'\n      children:\n        - nod: {}\n",
            "",
            "main.launch.yaml:5: action 'nod' is not supported",
        ),
        (include, "launch:\n\n  - nod: {}\n", "b.launch.yaml:3: action 'nod' is not supported"),
        (
            include,
            "launch:\n  - include: { file: $(dirname)/main.launch.yaml }\n",
            "b.launch.yaml:2: include: main.launch.yaml includes itself",
        ),
        (
            "launch:\n  - include:\n      file: $(dirname)/b.launch.yaml\n      arg:\n        - { name: inptu, value: x }\n",
            "launch:\n  - arg: { name: input, default: '' }\n",
            "main.launch.yaml:5: include: b.launch.yaml declares no argument 'inptu', did you mean 'input'?",
        ),
    ] {
        let refusal = Files::new(main).with("b.launch.yaml", included).refusal(&[]);
        assert!(refusal.starts_with(message), "not \"{message}\" but: {refusal}");
    }
}

#[test]
fn an_unknown_argument_is_refused_with_the_nearest_or_all_declared_ones() {
    let include = "launch:\n  - arg: { name: outer, default: '' }\n  \
                   - include: { file: $(dirname)/b.launch.yaml, arg: [{ name: fixed, value: x }] }\n";
    let inner = "launch:\n  - arg: { name: inner, default: '' }\n  - arg: { name: fixed }\n";
    let files = Files::new(include).with("b.launch.yaml", inner);
    assert!(files.resolve(&[("inner", "1"), ("outer", "2")]).is_ok());
    // An argument that an include fixes would be accepted and ignored.
    for (name, hint) in [("outre", ", did you mean 'outer'?"), ("fixed", ", declared are outer, inner")] {
        let expected = format!("unknown launch argument '{name}'{hint}");
        assert_eq!(files.refusal(&[(name, "1")]), expected);
    }
}

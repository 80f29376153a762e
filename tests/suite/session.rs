//! How sessions meet and are configured: a router, shared memory, the
//! variables of rmw_zenoh, and what is said when one of them is wrong.

use std::fs::File;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::process::Stdio;

use modulo_middleware::transport::Transport;
use modulo_middleware::transport::zenoh::meeting_port;
use modulo_runtime::MessageKind;

use crate::harness::{Background, Bench, Peer, borrowed, signal, text, wait_until};
use zenoh::Wait;

/// The meeting port is taken by somebody who does not speak zenoh: nodes then see each other through the router alone.
#[test]
fn a_router_is_used_when_there_is_one() {
    let bench = Bench::new();
    // A program that another test starts at this moment holds the sockets of this process until it runs, and with them
    // the port that the search for a free domain has just tried.
    let mut deaf = None;
    wait_until("the meeting port is free", || {
        deaf = TcpListener::bind(("127.0.0.1", meeting_port(bench.domain.id))).ok();
        deaf.is_some()
    });
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\""),
        ("listen/endpoints", "[\"tcp/127.0.0.1:7447\"]"),
        ("scouting/multicast/enabled", "false"),
    ] {
        config.insert_json5(key, value).expect("a known key");
    }
    // The port of the router is the same for all domains, so another program may hold it for a moment.
    let mut router = None;
    wait_until("port 7447 is free", || {
        router = zenoh::open(config.clone()).wait().ok();
        router.is_some()
    });
    let _unwrap = bench.start(&["run", "unwrap"]);
    wait_until("the node behind the router", || {
        text(&bench.run(&["node", "list"])).lines().any(|line| line == "/unwrap")
    });
    bench.says(0, "param get /unwrap method");
}

/// One key turns it on, and frames then really lie in shared memory.
#[test]
fn images_go_through_shared_memory() {
    let bench = Bench::new();
    bench.images(4);
    let peer = Peer::new(&bench);
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    let fixed = "source:=@/images model:=% engine:=rten rate:=10 loop:=true --summary @/summary.json";
    let words = bench.words(&format!("launch launch/recovered.launch.yaml {fixed}"));
    let mut launch = bench.modulo(&borrowed(&words));
    launch.env("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=true");
    let running = Background(launch.spawn().expect("it starts"));
    wait_until("a node with shared memory of zenoh", || {
        // A process that shares memory has a file of /dev/shm among its mappings.
        let maps = |node| std::fs::read_to_string(format!("/proc/{node}/maps")).unwrap_or_default();
        running.children().into_iter().any(|(node, _)| maps(node).contains("/dev/shm/"))
    });
    for _ in 0..5 {
        detections.until("an answer", |_| true);
    }
    assert_eq!(running.interrupt(), Some(0));
    let summary = bench.json("summary.json");
    assert!(summary["topics"]["/recovered"]["in"].as_u64() >= Some(5), "{summary}");
    assert_eq!(summary["topics"]["/modulo"]["bad"], 0, "{summary}");
}

#[test]
fn without_the_key_nothing_is_shared() {
    let bench = Bench::new();
    let unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let _reader = peer.hear("/recovered", MessageKind::Image);
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", unwrap.0.id())).expect("it runs");
    assert!(!maps.contains("/dev/shm/"), "{maps}");
}

/// Another session may be stopped while it has its turn; the turn only avoids a warning.
#[test]
fn a_turn_that_does_not_end_holds_nobody_up() {
    let bench = Bench::new();
    let folder = bench.folder.path().display().to_string();
    let lock = File::create(bench.path(&format!("modulo-meeting-{}.lock", meeting_port(bench.domain.id))));
    let lock = lock.expect("writable");
    lock.lock().expect("nobody else has it");
    let start = |arguments: &[&str]| {
        let mut command = bench.modulo(arguments);
        command.env("XDG_RUNTIME_DIR", &folder).env("TMPDIR", &folder);
        let command = command.stdout(Stdio::null()).stderr(Stdio::null());
        Background(command.spawn().expect("it starts"))
    };
    let (mut list, mut node) = (start(&["node", "list"]), start(&["run", "unwrap"]));
    // The handlers of signals are there before the session is opened.
    wait_until("the signal handlers", || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", node.0.id())).unwrap_or_default();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or("0");
        u64::from_str_radix(caught.trim(), 16).is_ok_and(|caught| caught & (1 << 14) != 0)
    });
    signal(node.0.id(), "TERM");
    for (what, child) in [("the list", &mut list.0), ("the node", &mut node.0)] {
        wait_until(what, || child.try_wait().expect("a child").is_some());
    }
    assert_eq!([&mut list, &mut node].map(|child| child.0.wait().expect("ended").code()), [Some(0); 2]);
    drop(lock);
}

/// Without a folder of the login session, no other user can reach the lock, either.
#[test]
fn the_lock_of_the_meeting_is_in_a_folder_of_the_user() {
    let bench = Bench::new();
    let mut list = bench.modulo(&["node", "list"]);
    list.env_remove("XDG_RUNTIME_DIR").env("TMPDIR", bench.folder.path());
    assert!(list.status().expect("it starts").success());
    let folders: Vec<_> = std::fs::read_dir(bench.folder.path()).expect("there").flatten().collect();
    let [folder] = &folders[..] else { panic!("{folders:?}") };
    assert_eq!(folder.metadata().expect("there").permissions().mode() & 0o777, 0o700);
    let lock = folder.path().join(format!("modulo-meeting-{}.lock", meeting_port(bench.domain.id)));
    assert!(lock.is_file(), "{}", lock.display());
}

#[test]
fn what_is_wrong_with_a_variable_is_said() {
    let bench = Bench::new();
    let missing = bench.path("missing.json5");
    let broken = bench.path("broken.json5");
    std::fs::write(&broken, "{ mode: \"pear\" }").expect("writable");
    let (missing, broken) = (missing.display().to_string(), broken.display().to_string());
    for (variable, value, named) in [
        ("ZENOH_SESSION_CONFIG_URI", missing.as_str(), "missing.json5"),
        ("ZENOH_SESSION_CONFIG_URI", broken.as_str(), "pear"),
        ("ZENOH_CONFIG_OVERRIDE", "mode", "key=json5"),
        ("ZENOH_CONFIG_OVERRIDE", "no/such/key=1", "no/such/key"),
        ("ZENOH_CONFIG_OVERRIDE", "mode=\"pear\"", "mode"),
        ("ROS_DOMAIN_ID", "500", "0 to 232"),
    ] {
        let output = bench.modulo(&["node", "list"]).env(variable, value).output().expect("it starts");
        let message = text(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{variable}={value}: {message}");
        assert!(message.contains(variable) && message.contains(named), "{variable}={value}: {message}");
        assert!(!message.contains("panicked"), "{message}");
    }
}

#[test]
fn a_configuration_file_is_used() {
    let bench = Bench::new();
    let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
    let file = |name: &str, way: &str| {
        let path = bench.path(name);
        let text = format!(
            "{{ mode: \"peer\", {way}: {{ endpoints: [\"tcp/127.0.0.1:{port}\"] }}, \
             scouting: {{ multicast: {{ enabled: false }} }} }}"
        );
        std::fs::write(&path, text).expect("writable");
        path
    };
    let (listens, connects) = (file("listens.json5", "listen"), file("connects.json5", "connect"));
    let mut node = bench.modulo(&["run", "unwrap"]);
    let node = node.env("ZENOH_SESSION_CONFIG_URI", listens).spawn().expect("it starts");
    let _node = Background(node);
    wait_until("the node through the file's endpoint", || {
        let mut list = bench.modulo(&["node", "list"]);
        let list = list.env("ZENOH_SESSION_CONFIG_URI", &connects).output().expect("it starts");
        text(&list).lines().any(|line| line == "/unwrap")
    });
    let elsewhere = bench.run(&["node", "list"]);
    assert!(!text(&elsewhere).contains("/unwrap"), "the file's session is another network");
}

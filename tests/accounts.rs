//! What a crash takes is counted, named and told by the exit code; what a live run replaces is only counted.

mod harness;

use std::time::Instant;

use harness::{Background, Bench, Heard, Peer, arg, json, model, signal, wait_until};
use modulo_runtime::transport::Transport;
use modulo_runtime::{Clock, Message, MessageKind, SystemClock};
use serde_json::Value;

/// All three nodes at 10 Hz without end; the summary goes to `summary.json`.
fn suite(bench: &Bench, more: &[&str]) -> Background {
    let (source, model) = (arg("source", bench.images(4)), arg("model", model()));
    let summary = bench.path("summary.json").display().to_string();
    let fixed =
        ["launch", "launch/recovered.launch.yaml", &source, &model, "engine:=rten", "rate:=10", "loop:=true"];
    bench.start(&[&fixed[..], &["--summary", &summary], more].concat())
}

fn stamp(message: &Message) -> u64 {
    match message {
        Message::Detections(array) => array.header.stamp.as_ns(),
        Message::Image(image) => image.header.stamp.as_ns(),
        other => panic!("no stamp in {other:?}"),
    }
}

/// Waits for the answer to a frame that was made from now on.
fn next_answer(heard: &Heard, what: &str) {
    let now = SystemClock::default().now_ns();
    heard.until(what, |message| stamp(message) >= now);
}

/// Stops the process until `count` frames on its `input` were sent after that.
fn stop_for_frames(input: &Heard, count: usize, process: u32) {
    signal(process, "STOP");
    let start = SystemClock::default().now_ns();
    for _ in 0..count {
        input.until("frames in the pause", |frame| stamp(frame) >= start);
    }
}

/// The sum of `field` over the topics that carry the frames.
fn sum(summary: &Value, field: &str) -> u64 {
    ["/modulo", "/recovered"]
        .iter()
        .map(|topic| summary["topics"][topic][field].as_u64().expect("a count"))
        .sum()
}

/// `MODULO_CRASH_ROUNDS` is how often each node is killed; once if it is not set.
#[test]
fn every_frame_is_answered_or_counted_when_nodes_are_killed() {
    let rounds = std::env::var("MODULO_CRASH_ROUNDS").map_or(1, |text| text.parse().expect("a number"));
    let bench = Bench::new();
    let running = suite(&bench, &[]);
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    let [modulo, recovered] = ["/modulo", "/recovered"].map(|topic| peer.hear(topic, MessageKind::Image));
    for round in 1..=rounds {
        for (kind, input) in
            [("detector", Some(&recovered)), ("unwrap", Some(&modulo)), ("modulo_camera", None)]
        {
            next_answer(&detections, "boxes before the crash");
            let victim = running.node(kind).expect("it runs");
            if let Some(input) = input {
                // It dies with frames in its hands.
                stop_for_frames(input, 4, victim);
            }
            signal(victim, "KILL");
            let crashed = Instant::now();
            next_answer(&detections, "boxes after the crash");
            // Shown and not held to a limit, since it depends on the load of the machine.
            println!("round {round}: {kind} is back after {:?}", crashed.elapsed());
        }
    }
    assert_eq!(running.interrupt(), Some(3), "frames were lost");
    let summary = json(&bench.path("summary.json"));
    for kind in ["detector", "unwrap", "modulo_camera"] {
        assert_eq!(summary["restarts"][kind], rounds, "{summary}");
    }
    let crashes = summary["lost_in_crashes"].as_array().expect("a list");
    let lost = |node: &str| {
        let of_node = crashes.iter().filter(|lost| lost["node"] == node);
        of_node.map(|lost| lost["lost"].as_u64().expect("known")).sum::<u64>()
    };
    assert!(lost("/unwrap") >= rounds && lost("/detector") >= rounds, "{summary}");
    let answered = summary["topics"]["/detector/detections"]["out"].as_u64().expect("a count");
    let counted = sum(&summary, "dropped") + sum(&summary, "bad") + lost("/unwrap") + lost("/detector");
    assert_eq!(summary["frames"], answered + counted, "{summary}");
}

/// A reader that stands still for some frames gets the newest image then.
#[test]
fn a_replaced_image_is_a_loss_only_when_that_is_asked_for() {
    for (more, code) in [(&[][..], 0), (&["--strict"], 3)] {
        let bench = Bench::new();
        let running = suite(&bench, more);
        let peer = Peer::new(&bench);
        wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
        let [frames, detections] =
            [("/modulo", MessageKind::Image), ("/detector/detections", MessageKind::Detections)]
                .map(|(topic, kind)| peer.hear(topic, kind));
        next_answer(&detections, "boxes before the pause");
        let reader = running.node("unwrap").expect("it runs");
        // Many come at once after the pause, far faster than they are unwrapped.
        stop_for_frames(&frames, 12, reader);
        signal(reader, "CONT");
        next_answer(&detections, "boxes after the pause");
        assert_eq!(running.interrupt(), Some(code), "{more:?}");
        let summary = json(&bench.path("summary.json"));
        assert!(summary["topics"]["/modulo"]["replaced"].as_u64() >= Some(2), "{summary}");
        assert_eq!(summary["lost_in_crashes"], serde_json::json!([]));
    }
}

/// One unreadable image among good ones: the others are sensed, and the exit code tells of it.
#[test]
fn an_unreadable_image_is_skipped_and_counted() {
    let bench = Bench::new();
    let images = bench.images(5);
    std::fs::write(images.join("000002.png"), "no picture").expect("writable");
    let (source, model) = (arg("source", images), arg("model", model()));
    let file = bench.path("summary.json").display().to_string();
    let output = bench.run(&[
        "launch",
        "launch/recovered.launch.yaml",
        &source,
        &model,
        "engine:=rten",
        "--summary",
        &file,
    ]);
    assert_eq!(output.status.code(), Some(3), "{}", harness::text(&output));
    let summary = json(&bench.path("summary.json"));
    assert_eq!(
        (&summary["frames"], &summary["topics"]["source"]["bad"]),
        (&4.into(), &1.into()),
        "{summary}"
    );
    assert_eq!(summary["topics"]["/detector/detections"]["out"], 4, "{summary}");
}

/// `modulo launch FILE | head` ended with a panic and without the summary's file.
#[test]
fn a_closed_pipe_costs_neither_the_exit_code_nor_the_summary() {
    let bench = Bench::new();
    let (source, model) = (arg("source", bench.images(2)), arg("model", model()));
    let file = bench.path("summary.json").display().to_string();
    let arguments = [
        "launch",
        "--compose",
        "launch/raw.launch.yaml",
        &source,
        &model,
        "engine:=rten",
        "--summary",
        &file,
    ];
    let mut child = bench.modulo(&arguments).stdout(std::process::Stdio::piped()).spawn().expect("it starts");
    drop(child.stdout.take());
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
    assert_eq!(json(&bench.path("summary.json"))["frames"], 2);
}

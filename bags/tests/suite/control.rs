//! The services of a player: what a request asks for, what a response says.

use std::sync::mpsc::channel;
use std::thread;

use modulo_bags::control::{PlayerAction, PlayerCommand, PlayerReply, Service};
use modulo_bags::playback_clock::PlaybackState;
use modulo_msgs::builtin::Time;
use modulo_msgs::cdr;
use modulo_msgs::rosbag2_interfaces::{
    BurstRequest, BurstResponse, GetRateResponse, IsPausedResponse, PauseRequest, SeekRequest,
    SetRateRequest, SetRateResponse,
};

fn action<T: serde::Serialize>(service: Service, request: &T) -> PlayerAction {
    service.action(&cdr::to_vec(request).expect("short")).expect("readable")
}

#[test]
fn requests_are_commands() {
    assert_eq!(action(Service::Pause, &PauseRequest), PlayerAction::Move(Some(PlaybackState::Paused)));
    assert_eq!(action(Service::SetRate, &SetRateRequest { rate: 0.5 }), PlayerAction::SetRate(0.5));
    assert_eq!(action(Service::Burst, &BurstRequest { num_messages: 3 }), PlayerAction::Step(Some(3)));
    assert_eq!(action(Service::Burst, &BurstRequest { num_messages: 0 }), PlayerAction::Step(None));
    let time = Time { sec: 2, nanosec: 5 };
    assert_eq!(action(Service::Seek, &SeekRequest { time }), PlayerAction::Seek(2_000_000_005));
    assert!(Service::Seek.action(&[0, 1, 0, 0, 7]).is_err(), "a request that is cut");
    for service in Service::ALL {
        let (_, ros_type) = service.name_and_type();
        assert!(modulo_msgs::type_hash(ros_type).is_some(), "{ros_type}");
    }
}

#[test]
fn answers_are_responses() {
    let (queue, orders) = channel::<PlayerCommand>();
    let replay = thread::spawn(move || {
        for order in orders {
            let answer = PlayerReply { done: false, played: 4, state: PlaybackState::Paused, rate: 2.5 };
            order.answer.send(answer).expect("somebody waits");
        }
    });
    let burst = cdr::to_vec(&BurstRequest { num_messages: 9 }).expect("short");
    let rate = cdr::to_vec(&SetRateRequest { rate: -1.0 }).expect("short");
    let empty = cdr::to_vec(&PauseRequest).expect("short");
    let call = |service: Service, request: &[u8]| {
        service.call(request, &|order| queue.send(order).is_ok()).expect("answered")
    };
    let burst: BurstResponse = cdr::from_slice(&call(Service::Burst, &burst)).expect("a response");
    assert_eq!(burst.actually_burst, 4);
    let set: SetRateResponse = cdr::from_slice(&call(Service::SetRate, &rate)).expect("a response");
    assert!(!set.success);
    let rate: GetRateResponse = cdr::from_slice(&call(Service::GetRate, &empty)).expect("a response");
    assert_eq!(rate.rate, 2.5);
    let paused: IsPausedResponse = cdr::from_slice(&call(Service::IsPaused, &empty)).expect("a response");
    assert!(paused.paused);
    drop(queue);
    replay.join().expect("ends");
    let (queue, orders) = channel();
    drop(orders);
    assert!(
        Service::Pause.call(&empty, &|order| queue.send(order).is_ok()).is_err(),
        "nobody replays any more"
    );
}

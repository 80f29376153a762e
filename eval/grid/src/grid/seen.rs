//! [`Seen`]: what one cell makes of one frame, and all frames of a cell side by side.

use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use modulo_bags::source::SourceError;
use modulo_core::Detection;

use super::GridError;
use super::chain::{Passed, Stages};
use super::eye::{Eye, Memory};
use super::frames::Frames;
use super::moment::{Moment, Moments, Neighbours};
use super::recovery::Recovery;

/// One frame of one cell.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Best first; `None`: no answer came.
    pub found: Option<Arc<Vec<Detection>>>,
    /// All stages, in order.
    pub stages: Stages,
    /// How near a recovered image is to the truth.
    pub recovery: Option<Recovery>,
}

/// The way of a frame to the detector, of one worker and one cell.
pub type Way<'a> = Box<dyn FnMut(Moment) -> Result<Passed, GridError> + Send + 'a>;

type Read = Result<Moment, SourceError>;

/// Every frame through `ways`, one for each of `eyes`; frames are read ahead on a thread of their own.
///
/// # Errors
/// [`GridError`] of the first frame that cannot be had or worked on.
pub fn look_at_all(
    (frames, neighbours): (&mut Frames, Neighbours),
    ways: Vec<Way<'_>>,
    eyes: &mut [Eye<'_>],
    memory: &Memory,
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Seen>, GridError> {
    let all = Mutex::new(vec![Seen::default(); frames.len()]);
    let moments = Moments::new(frames, neighbours)?;
    let (send, receive) = sync_channel::<Read>(eyes.len() + 1);
    // Every worker holds a share of the receiver: when all of them have ended, nobody waits to send.
    let receive = Arc::new(Mutex::new(receive));
    std::thread::scope(|scope| {
        let workers: Vec<_> = ways
            .into_iter()
            .zip(eyes)
            .map(|(mut way, eye)| {
                let (all, receive) = (&all, receive.clone());
                scope.spawn(move || -> Result<(), GridError> {
                    while let Some(frame) = take(&receive) {
                        let moment = frame?;
                        let number = moment.number;
                        let seen = look(&mut way, eye, memory, moment)?;
                        if let Some(place) =
                            all.lock().unwrap_or_else(PoisonError::into_inner).get_mut(number)
                        {
                            *place = seen;
                        }
                        done();
                    }
                    Ok(())
                })
            })
            .collect();
        drop(receive);
        // Reading ahead happens here, on the caller's own thread.
        for frame in moments {
            if send.send(frame).is_err() {
                break;
            }
        }
        drop(send);
        workers.into_iter().try_for_each(|worker| match worker.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        })
    })?;
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

fn take(receive: &Mutex<Receiver<Read>>) -> Option<Read> {
    receive.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

fn look(way: &mut Way<'_>, eye: &mut Eye<'_>, memory: &Memory, moment: Moment) -> Result<Seen, GridError> {
    let number = moment.number;
    let Passed { image, mut stages, recovery } = way(moment)?;
    let Some(image) = image else { return Ok(Seen { found: None, stages, recovery }) };
    let answer = eye.look(number, image, memory)?;
    stages.extend(answer.stages);
    Ok(Seen { found: answer.found, stages, recovery })
}

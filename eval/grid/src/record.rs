//! [`Timelines`]: runs the nodes of a launch file for what people look at: a bag, the images of the streams, and those with the boxes
//! that the detectors draw.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, LockstepError};

use crate::plan::CameraPlan;
use crate::recordings::Recordings;
use crate::timeline::Timeline;

/// The frames that each camera has sent, over all its sources, by its name.
#[derive(Default)]
pub struct Timelines(BTreeMap<String, Timeline>);

impl Timelines {
    /// Runs the cameras of `chain` to their ends, and writes `recordings`. After each frame it calls `tell`, which may
    /// stop the run.
    ///
    /// # Errors
    /// [`LockstepError`] if a node fails; the frames before stay.
    pub fn record(
        &mut self,
        chain: &mut Lockstep<'_>,
        cameras: &[CameraPlan],
        recordings: &mut Recordings,
        tell: &dyn Fn(&Lockstep<'_>) -> ControlFlow<()>,
    ) -> Result<(), LockstepError> {
        let mut running: Vec<&CameraPlan> = cameras.iter().collect();
        // The time of the chain goes on over all sources, as in one long run. The camera whose frame is due first comes first.
        let due = |timelines: &Self, camera: &CameraPlan| {
            let frames = timelines.0.get(&camera.name).map_or(0, |timeline| timeline.frames);
            frames.saturating_mul(nanos(camera.interval))
        };
        while let Some(next) = (0..running.len()).min_by_key(|&index| due(self, running[index])) {
            let camera = running[next];
            let before = chain.position(camera.member);
            let Some(mut out) = chain.tick(camera.member, due(self, camera))? else {
                recordings.end(running.remove(next));
                continue;
            };
            // A loss that the source tells, such as the cut end of a bag, is no frame and has no number.
            if out.is_empty() && before.is_some() && chain.position(camera.member) == before {
                continue;
            }
            let timeline = self.0.entry(camera.name.clone()).or_default();
            let number = timeline.frames;
            timeline.place(&mut out, camera.interval);
            recordings.add(cameras, (camera, number), &out, next + 1 == running.len());
            if tell(chain).is_break() {
                break;
            }
        }
        Ok(())
    }
}

//! [`SceneSource`]: frames of the suite's own procedural scene, with exact
//! ground truth. It ends after the frames that its address gives, or never.

use modulo_scene::{SceneObject, SceneSpec};

use super::{GroundTruth, Source, SourceError, SourceFrame};

/// A scene at its present frame.
pub struct SceneSource {
    spec: SceneSpec,
    frame: u32,
}

impl SceneSource {
    /// Opens the scene of `scene://PRESET?seed=N&frames=N&width=W&height=H`.
    ///
    /// # Errors
    /// [`SourceError::Scene`] when the address does not name a scene.
    pub fn open(address: &str) -> Result<Self, SourceError> {
        Ok(Self { spec: address.parse()?, frame: 0 })
    }
}

impl Source for SceneSource {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        if self.len().is_some_and(|frames| self.frame as usize >= frames) {
            return None;
        }
        let rendered = self.spec.scene().render(self.frame, self.spec.height, self.spec.width);
        let name = format!("{:06}", self.frame);
        // A scene without an end may run past the largest number.
        self.frame = self.frame.wrapping_add(1);
        let ground_truth = Some(rendered.objects.iter().map(label).collect());
        Some(Ok(SourceFrame { ground_truth, ..SourceFrame::new(name, rendered.radiance) }))
    }

    fn skip(&mut self, frames: u64) {
        self.frame = self.frame.wrapping_add(frames as u32);
    }

    fn len(&self) -> Option<usize> {
        Some(self.spec.frames as usize).filter(|frames| *frames > 0)
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        self.frame = 0;
        Ok(())
    }
}

/// Describes the hidden fraction, by other objects or by the border, in KITTI's three steps. The second step ends at
/// one half.
fn label(object: &SceneObject) -> GroundTruth {
    let occluded = match object.occlusion + object.truncation {
        hidden if hidden < 0.1 => 0,
        hidden if hidden <= 0.5 => 1,
        _ => 2,
    };
    GroundTruth {
        bbox: object.bbox,
        class: object.class.name().to_owned(),
        truncated: object.truncation,
        occluded,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_follow_each_other_and_start_again() {
        let mut source =
            SceneSource::open("scene://day?seed=3&width=96&height=32&frames=2").expect("a scene");
        let mut next = || source.next().expect("not over").expect("a frame");
        let (first, second) = (next(), next());
        assert_eq!(first.radiance.dim(), (32, 96, 3));
        assert_ne!(first.radiance, second.radiance);
        assert!(source.next().is_none(), "two frames were asked for");
        source.rewind().expect("nothing to fail");
        assert_eq!(source.next().expect("not over").expect("a frame"), first);
    }

    #[test]
    fn what_is_no_scene_is_refused() {
        let error = SceneSource::open("scene://dusk").err().expect("no such preset");
        assert!(error.to_string().contains("dusk") && error.to_string().contains("tunnel"), "{error}");
    }
}

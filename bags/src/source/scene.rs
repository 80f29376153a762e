//! [`open`]: frames of the suite's own procedural scene, with exact ground truth. They end after the number that its address gives, or never.

use modulo_scene::{SceneObject, SceneSpec};

use super::{GroundTruth, ReadFrames, Source, SourceError, SourceFrame};

/// A scene at its present frame.
struct SceneFrames {
    spec: SceneSpec,
    frame: u32,
}

/// Opens the scene of `scene://PRESET?seed=N&frames=N&width=W&height=H`.
pub(super) fn open(address: &str) -> Result<Source, SourceError> {
    let spec: SceneSpec = address.parse()?;
    let len = Some(spec.frames as usize).filter(|frames| *frames > 0);
    Ok(Source { len, ..Source::over(SceneFrames { spec, frame: 0 }) })
}

impl ReadFrames for SceneFrames {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        if self.spec.frames > 0 && self.frame >= self.spec.frames {
            return None;
        }
        let rendered = self.spec.scene.render(self.frame, self.spec.height, self.spec.width);
        let name = format!("{:06}", self.frame);
        // A scene without an end may run past the largest number.
        self.frame = self.frame.wrapping_add(1);
        let ground_truth = Some(rendered.objects.iter().map(label).collect());
        Some(Ok(SourceFrame { ground_truth, ..SourceFrame::new(name, rendered.radiance) }))
    }

    fn pass(&mut self, frames: u64) {
        self.frame = self.frame.wrapping_add(frames as u32);
    }

    fn rewind(&mut self) {
        self.frame = 0;
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
        let mut source = open("scene://day?seed=3&width=96&height=32&frames=2").expect("a scene");
        let mut next = || source.next().expect("not over").expect("a frame");
        let (first, second) = (next(), next());
        assert_eq!(first.radiance.dim(), (32, 96, 3));
        assert_ne!(first.radiance, second.radiance);
        assert!(source.next().is_none(), "two frames were asked for");
        source.rewind();
        assert_eq!(source.next().expect("not over").expect("a frame"), first);
    }

    #[test]
    fn what_is_no_scene_is_refused() {
        let error = open("scene://dusk").err().expect("no such preset");
        assert!(error.to_string().contains("dusk") && error.to_string().contains("tunnel"), "{error}");
    }
}

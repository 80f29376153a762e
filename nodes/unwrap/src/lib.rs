//! The `unwrap` node: a modulo image in, the recovered image out, with 8 bits for a detector, sharpened on request, metered (with the exposure
//! that the frame itself asks for), and
//! as HDR: the counts that the sensor saw, exact, as integers of 16 bits where `alpha * 2^bits <= 65536`, else as
//! floats. On request, both are without the noise of the sensor.
//!
//! A colour mosaic is unwrapped as it is. `recovered` shows it with three colours at each pixel, `hdr` keeps the mosaic.
//!
//! The header of the modulo image is copied. The node never guesses the sensor: its model is a group of parameters, as
//! in the camera. The method used, its quality metrics and its trust are published on `/diagnostics` for each frame, as
//! the method reports them, and on `recovery` for a detector that selects its input by it; the node judges nothing itself.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use modulo_core::deblur::Deblur;
use modulo_core::unwrap::{
    Method, Options, QualityMetrics, Recovered, Report, Scene, ThresholdOn, Trust, TrustLimits, Unwrap,
    UnwrapError, of_gains,
};
use modulo_core::{FrameError, MAX_THREADS, Psf, Range, exposed_anew, tone};
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::sensor::parameters::SensorOverride;
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::sensor_info::{self, SensorHistory};
use modulo_runtime::topic::{self, ImageCompression, RECOVERY_TOPIC};
use modulo_runtime::{
    Context, Flow, Message, MessageKind, Node, ParameterError, ParameterSet as _, Parameters, SensorModel,
    StampedFrame, StepError, StreamKind, Topic, Trigger, warn_once,
};

/// Output indices, in the order of [`Node::outputs`].
const RECOVERED: usize = 0;
const HDR: usize = 1;
const DIAGNOSTICS: usize = 2;
const RECOVERY: usize = 3;
const CONFIDENCE: usize = 4;
const METERED: usize = 5;
const SENSOR_INFO: usize = 6;

/// The images that a description of the sensor covers.
const STREAMS: [(usize, StreamKind); 3] =
    [(RECOVERED, StreamKind::Recovered), (METERED, StreamKind::Metered), (HDR, StreamKind::Hdr)];

/// Why a frame without a sensor description is skipped.
const UNDESCRIBED: &str = "no sensor description has come on the topic sensor_info; start a camera or replay a bag that has this \
                           topic (modulo bag play --topics /modulo /sensor_info), or set the parameters bits and alpha";

modulo_runtime::parameters! {
    /// The parameters of the `unwrap` node.
    pub struct UnwrapParameters {
        /// Unwrapping method. auto decodes by proof where the lens and the noise are described; else it tries lines, gradient_tree, a tree
        /// on smoothed codes, and growth of what is known (spud where noise hides all), until a result does not contradict itself.
        /// Images of a sensor with two gains (see gains) have a method of their own.
        method: Method = Method::Auto => Method::ALL,
        /// Number of threads that unwrapping may use. The result does not depend on it.
        threads: usize = 1 => 1..=MAX_THREADS,
        /// Removes the blur of the lens (psf, psf_sigma) from the recovered image after unwrapping. The hdr image keeps
        /// it.
        deblur: bool = false,
        /// For auto: the largest fraction of steep 2 x 2 loops with which it trusts a result in a single colour.
        trust_lines: f64 = TrustLimits::default().lines => 0.0..=1.0,
        /// For auto: the largest number of second differences of the result above one peak, per sample, with which it trusts
        /// a result.
        trust_jumps: f64 = TrustLimits::default().jumps => 0.0..=2.0,
        /// For auto: the work that it may do on a frame, as the time of its candidates in ms on one core of a server of 2023 (modulo doctor
        /// gives the time here). It is counted and not measured, so that a replay gives the same images. A candidate that exceeds it is not
        /// tried: the best result so far is published, not trusted, and counted. 0: no limit.
        budget: f64 = 225.0 => 0.0..=1e6,
        /// For spud: the hard threshold, in units of the peak.
        tau: f64 = Options::default().tau => 0.0..=1e6,
        /// For spud: the threshold acts on the coefficients after the division (phi) or before it (rho).
        threshold_on: ThresholdOn = ThresholdOn::Phi => [("phi", ThresholdOn::Phi), ("rho", ThresholdOn::Rho)],
        ..sensor: SensorOverride,
    }
}

impl UnwrapParameters {
    /// Returns the options of the unwrapping method.
    pub fn options(&self) -> Options {
        Options {
            tau: self.tau,
            threshold_on: self.threshold_on,
            threads: self.threads,
            trust: TrustLimits { lines: self.trust_lines, jumps: self.trust_jumps },
            successive: true,
        }
    }

    /// Returns the unwrapping method with its options.
    ///
    /// # Errors
    /// [`ParameterError`] of the first parameter that is out of its range, or of `threads` that the machine does not have.
    pub fn method(&self) -> Result<Box<dyn Unwrap>, ParameterError> {
        self.check()?;
        // The other parameters are possible: the machine may have no more threads.
        let refused = |why: UnwrapError| ParameterError::new("threads", self.threads, why.to_string());
        self.method.build(&self.options()).map_err(refused)
    }
}

/// The unwrapping of modulo images as a node.
pub struct UnwrapNode {
    parameters: UnwrapParameters,
    method: Box<dyn Unwrap>,
    /// The sensor descriptions that the camera has sent.
    described: SensorHistory,
    /// The sensor of the last frame with what is prepared for it.
    sensor: Option<Prepared>,
    /// A frame that came before the first sensor description.
    deferred: Option<Arc<StampedFrame>>,
    /// Whether a frame has waited for the first description in vain: those that follow do not wait.
    undescribed: bool,
    /// Frames whose own description was late or lost, so that an earlier one was used.
    reused: u64,
    recovered: Recovered,
    counts: RecoveryCounts,
    /// Whether a parameter that contradicts the camera was reported.
    contradiction_reported: bool,
}

/// A sensor with the values that are computed from it once.
struct Prepared {
    model: SensorModel,
    range: Range,
    /// Removes the blur of the lens from `recovered`, if that is requested.
    deblur: Option<Deblur>,
    /// The method for a sensor with two gains, which replaces the one of the parameters.
    of_gains: Option<Box<dyn Unwrap>>,
}

impl UnwrapNode {
    /// Prepares the method that the parameters name.
    ///
    /// # Errors
    /// [`ParameterError`] with the parameter that is not possible.
    pub fn new(parameters: &UnwrapParameters) -> Result<Self, ParameterError> {
        Ok(Self {
            parameters: parameters.clone(),
            method: parameters.method()?,
            described: SensorHistory::default(),
            sensor: None,
            deferred: None,
            undescribed: false,
            reused: 0,
            recovered: Recovered::default(),
            counts: RecoveryCounts::default(),
            contradiction_reported: false,
        })
    }

    /// Prepares for the sensor that made the frame of `stamp`.
    fn prepare(&mut self, stamp: Time) -> Result<(), ParameterError> {
        let camera = self.described.nearest(stamp);
        let model = self.parameters.sensor.over(camera)?;
        if let Some(camera) = camera
            && (camera.bits, camera.alpha) != (model.bits, model.alpha)
            // Reported once, and not with each frame.
            && !std::mem::replace(&mut self.contradiction_reported, true)
        {
            tracing::warn!(
                "the parameters bits {} and alpha {} override the camera's bits {} and alpha {}",
                model.bits,
                model.alpha,
                camera.bits,
                camera.alpha
            );
        }
        // The taps of the filter take time to compute, and the methods keep buffers, so both are made anew only for another sensor.
        if self.sensor.as_ref().is_none_or(|prepared| prepared.model != model) {
            let blur = Some(model.psf()).filter(|psf| self.parameters.deblur && *psf != Psf::None);
            let deblur = blur.map(Deblur::new);
            model.unfit().into_iter().for_each(warn_once);
            let range = model.range()?;
            let of_gains = of_gains(model.gains()?);
            self.sensor = Some(Prepared { model, range, deblur, of_gains });
        }
        Ok(())
    }

    /// Unwraps `modulo`. Before the very first sensor description it is deferred for a while.
    fn take(&mut self, modulo: Arc<StampedFrame>, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let stamp = modulo.header.stamp;
        // Bits and alpha may both be set as parameters: then no description is needed.
        if !self.parameters.sensor.is_complete() {
            if self.described.latest().is_none() {
                return self.defer(modulo);
            }
            // The description goes before its frame, so that it is late or lost; the sensor changes rarely.
            self.reused += u64::from(self.described.of(stamp).is_none());
        }
        self.prepare(stamp).map_err(|why| StepError::Skip(why.to_string()))?;
        self.unwrap(&modulo, cx)?;
        Ok(Flow::Continue)
    }

    /// Defers `modulo` to the first sensor description, or skips it when that was waited for in vain.
    fn defer(&mut self, modulo: Arc<StampedFrame>) -> Result<Flow, StepError> {
        if self.undescribed {
            return Err(StepError::Skip(UNDESCRIBED.into()));
        }
        // Only the newest frame is kept.
        match self.deferred.replace(modulo) {
            None => Ok(Flow::Deferred),
            Some(_) => Err(StepError::Skip(UNDESCRIBED.into())),
        }
    }

    /// Takes a sensor description; unwraps the frame that was deferred to it.
    fn describe(&mut self, info: &DiagnosticArray, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        // Descriptions are kept by stamp, since the one of the next frame may come before this frame.
        self.described.note(info).map_err(|why| StepError::Skip(why.to_string()))?;
        self.undescribed = false;
        match self.deferred.take() {
            Some(modulo) => self.take(modulo, cx),
            None => Ok(Flow::Continue),
        }
    }

    fn unwrap(&mut self, modulo: &StampedFrame, cx: &mut Context<'_>) -> Result<(), StepError> {
        let skip = |why: String| StepError::Skip(why);
        let Prepared { model, range, of_gains, .. } = self.sensor.as_mut().expect("`prepare` comes before");
        let work = Some(self.parameters.budget).filter(|budget| *budget > 0.0).unwrap_or(f64::INFINITY);
        let scene = Scene { range: *range, lens: model.lens(), noise: model.noise(), work, radiance: false };
        let method = of_gains.as_mut().unwrap_or(&mut self.method);
        let out = &mut self.recovered;
        cx.stage("unwrap", || method.unwrap(&modulo.frame, &scene, out))
            .map_err(|why| skip(why.to_string()))?;
        self.counts.count(&self.recovered.report);
        if cx.wanted(SENSOR_INFO) {
            let (height, width, _) = modulo.frame.dim();
            let of_frame = (&modulo.header, (height, width));
            cx.emit(SENSOR_INFO, sensor_info::message_of(of_frame, model, cx, &STREAMS));
        }
        let status = (cx.wanted(DIAGNOSTICS) | cx.wanted(RECOVERY)).then(|| {
            let report = &self.recovered.report;
            Message::Diagnostics(Arc::new(describe(cx.node(), &modulo.header, self.method.name(), report)))
        });
        let emit = |output, cx: &mut Context<'_>| {
            if let (Some(status), true) = (&status, cx.wanted(output)) {
                cx.emit(output, status.clone());
            }
        };
        emit(DIAGNOSTICS, cx);
        self.emit_images(modulo, cx).map_err(|why| skip(why.to_string()))?;
        // After the image: a detector that changes its input because of it has answered this frame already.
        emit(RECOVERY, cx);
        Ok(())
    }

    /// Sends the pictures for a detector that have a reader.
    fn emit_pictures(&self, modulo: &StampedFrame, cx: &mut Context<'_>) -> Result<(), FrameError> {
        if !cx.wanted(RECOVERED) && !cx.wanted(METERED) {
            return Ok(());
        }
        let Prepared { model, range, deblur, .. } = self.sensor.as_ref().expect("`prepare` comes before");
        let Recovered { x: radiance, k, .. } = &self.recovered;
        // Counts suffice for the picture that nothing else is to be done with.
        if radiance.is_empty() {
            let frame =
                cx.stage("tone", || tone::picture_of_counts(&modulo.frame, k, *range, model.transfer))?;
            cx.emit(RECOVERED, StampedFrame { header: modulo.header.clone(), frame });
            return Ok(());
        }
        let x = match modulo.frame.mosaic() {
            None => Cow::Borrowed(radiance),
            Some(mosaic) => Cow::Owned(cx.stage("demosaic", || mosaic.demosaic(radiance.view()))),
        };
        // A sharpened image is for the detector only: `hdr` keeps what the sensor saw.
        let shown = |cx: &mut Context<'_>, range| match deblur {
            None => cx.stage("tone", || tone::picture(&x, range, model.transfer)),
            Some(deblur) => cx.stage("deblur", || deblur.picture(&x, range, model.transfer)),
        };
        if cx.wanted(RECOVERED) {
            let frame = shown(cx, *range)?;
            cx.emit(RECOVERED, StampedFrame { header: modulo.header.clone(), frame });
        }
        if cx.wanted(METERED) {
            let SensorModel { metering, metering_target, .. } = *model;
            let range = cx.stage("meter", || exposed_anew(&x, *range, metering, metering_target));
            let frame = shown(cx, range)?;
            cx.emit(METERED, StampedFrame { header: modulo.header.clone(), frame });
        }
        Ok(())
    }

    /// Sends the images of the result that have a reader.
    fn emit_images(&mut self, modulo: &StampedFrame, cx: &mut Context<'_>) -> Result<(), FrameError> {
        let Prepared { range, deblur, .. } = self.sensor.as_ref().expect("`prepare` comes before");
        // The radiance has few readers, and takes four times the memory of the codes.
        if deblur.is_some() | cx.wanted(METERED) | cx.wanted(HDR) | cx.wanted(CONFIDENCE) {
            cx.stage("radiance", || self.recovered.fill(&modulo.frame, *range));
        }
        let (mosaic, radiance) = (modulo.frame.mosaic(), &self.recovered.x);
        self.emit_pictures(modulo, cx)?;
        if cx.wanted(HDR) {
            let frame = tone::hdr(radiance, *range)?;
            // There is no encoding for a mosaic of floats.
            let frame = match mosaic.filter(|_| frame.depth() == 16) {
                Some(mosaic) => frame.with_mosaic(mosaic).expect("it has the shape of the modulo image"),
                None => frame,
            };
            // Without a scale: a reader gets the counts of the sensor and can compute with them.
            cx.emit(HDR, StampedFrame { header: modulo.header.clone(), frame });
        }
        if cx.wanted(CONFIDENCE) {
            let frame = cx.stage("confidence", || self.recovered.confidence(mosaic, *range));
            cx.emit(CONFIDENCE, StampedFrame { header: modulo.header.clone(), frame });
        }
        Ok(())
    }
}

/// Returns the topics that an unwrap node publishes.
pub fn outputs() -> Vec<Topic> {
    vec![
        Topic::new("recovered", MessageKind::Image),
        // It may have floats, which no compressed variant can hold.
        Topic { compression: ImageCompression::None, ..Topic::new("hdr", MessageKind::Image) },
        topic::diagnostics(),
        Topic::new(RECOVERY_TOPIC, MessageKind::Diagnostics),
        Topic::new("confidence", MessageKind::Image),
        Topic::new("metered", MessageKind::Image),
        sensor_info::recovered_topic(),
    ]
}

impl Node for UnwrapNode {
    fn inputs(&self) -> Vec<Topic> {
        let modulo =
            Topic { compression: ImageCompression::Lossless, ..Topic::new("modulo", MessageKind::Image) };
        vec![modulo, sensor_info::topic()]
    }

    fn outputs(&self) -> Vec<Topic> {
        outputs()
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let (parameters, last) = (UnwrapParameters::from(parameters), &self.parameters);
        // A method has threads, and buffers of the size of an image: it stays where nothing of it has changed.
        if (parameters.method, parameters.options()) != (last.method, last.options()) {
            self.method = parameters.method()?;
            // The method of two gains has these options, too.
            self.sensor = None;
        }
        // A change of the sensor is seen at the next frame.
        if parameters.deblur != last.deblur {
            self.sensor = None;
        }
        (self.parameters, self.contradiction_reported) = (parameters, false);
        Ok(())
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        match trigger {
            Trigger::Message { message: Message::Image(modulo), .. }
                // Without any reader the whole work is saved.
                if (RECOVERED..=METERED).any(|output| cx.wanted(output)) =>
            {
                self.take(modulo, cx)
            }
            Trigger::Message { message: Message::Diagnostics(info), .. } => self.describe(&info, cx),
            Trigger::Message { .. } | Trigger::Tick => Ok(Flow::Continue),
        }
    }

    fn give_up(&mut self) -> Option<String> {
        self.deferred.take()?;
        self.undescribed = true;
        Some(UNDESCRIBED.to_owned())
    }

    fn state(&self) -> Vec<(&'static str, String)> {
        let UnwrapParameters { deblur, threads, .. } = &self.parameters;
        let mut state = vec![
            ("method", self.method.name().to_owned()),
            ("deblur", deblur.to_string()),
            ("threads", threads.to_string()),
        ];
        // Before the first frame, the camera's sensor is not known.
        state.extend(self.sensor.iter().flat_map(|prepared| prepared.model.to_text()));
        state
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        let mut status = vec![("method", self.method.name().to_owned())];
        status.extend(self.counts.status());
        if self.reused > 0 {
            status.push(("description_reused", self.reused.to_string()));
        }
        status
    }
}

/// Number of frames for each method that was used, and number of trusted frames and of those with better results left out.
#[derive(Default)]
struct RecoveryCounts {
    methods: BTreeMap<&'static str, u64>,
    trusted: u64,
    over_budget: u64,
}

impl RecoveryCounts {
    fn count(&mut self, report: &Report) {
        *self.methods.entry(report.method).or_default() += 1;
        self.trusted += u64::from(report.trust == Trust::Trusted);
        self.over_budget += u64::from(report.is_over_budget);
    }

    /// Returns `("methods_used", "lines 58, gradient_tree 2")` `("trusted", "58 of 60 frames")` and the same as a share; nothing before the first
    /// frame.
    fn status(&self) -> Vec<(&'static str, String)> {
        let frames: u64 = self.methods.values().sum();
        if frames == 0 {
            return Vec::new();
        }
        let methods = self.methods.iter().map(|(method, count)| format!("{method} {count}"));
        let mut status = vec![
            ("methods_used", methods.collect::<Vec<_>>().join(", ")),
            ("trusted", format!("{} of {frames} frames", self.trusted)),
            ("trusted_share", format!("{:.4}", self.trusted as f64 / frames as f64)),
        ];
        if self.over_budget > 0 {
            status.push(("over_budget", format!("{} of {frames} frames", self.over_budget)));
        }
        status
    }
}

/// Returns the level and the text of the status of a frame with this `report`.
fn level_of(report: &Report) -> (u8, String) {
    match report.reason() {
        Some(reason) => (DiagnosticStatus::WARN, format!("not trusted: {reason}")),
        None if report.trust == Trust::Trusted => (DiagnosticStatus::OK, "trusted".to_owned()),
        None => (DiagnosticStatus::OK, "the method makes no claim".to_owned()),
    }
}

/// Returns the status of one recovered frame, stamped as its image, under the name that ROS gives a status of the fully
/// qualified `node`.
fn describe(node: &str, header: &Header, method: &str, report: &Report) -> DiagnosticArray {
    // Two names: the method that was asked for, and the one that `auto` selected for this frame.
    let mut values = vec![("method", method.to_owned()), (Recovery::METHOD_USED, report.method.to_owned())];
    // A method without a claim has no entry, so that no reader takes it for distrust.
    if let Some(trusted) = report.trust.claim() {
        values.push((Recovery::TRUSTED, trusted.to_string()));
    }
    // The evidence for the absolute offset, so that a reader knows when it comes from the frame before.
    if let Some(evidence) = report.offset_evidence() {
        values.push(("offset", evidence.to_owned()));
    }
    if report.is_over_budget {
        values.push(("over_budget", "true".to_owned()));
    }
    if let Some(QualityMetrics { residues, steep, clamped, jumps, defects }) = report.quality {
        let shares = [
            ("residues", residues),
            ("steep", steep),
            ("clamped", clamped),
            ("jumps", jumps),
            ("defects", defects),
        ];
        values.extend(shares.map(|(name, share)| (name, format!("{share:.3e}"))));
    }
    let (level, message) = level_of(report);
    let (name, values) = (format!("{}: recovery", node.trim_start_matches('/')), KeyValue::all(values));
    let status = DiagnosticStatus { level, name, message, values, hardware_id: String::new() };
    DiagnosticArray::of(header.clone(), status)
}

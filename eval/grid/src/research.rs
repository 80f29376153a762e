//! [`variants`]: the nodes of a launch file, and in the place of a camera and its unwrapping the makers of images that no node makes.

use std::collections::BTreeMap;

use modulo_camera::CameraParameters;
use modulo_runtime::{NodeName, ParameterSet as _, SensorModel};

use crate::GridError;
use crate::makers::{BRACKETS, OF_PAPER, PAPER};
use crate::paper::SPUD_AS_PUBLISHED;
use crate::plan::{CAMERA, DETECTOR, PlannedNode, Variant};

/// The sensor of the paper behind a Gaussian of about its lens.
pub fn sensor_of_paper(alpha: f64) -> SensorModel {
    let SensorModel { psf, psf_sigma, .. } = SensorModel::default();
    SensorModel { psf, psf_sigma, alpha, headroom: 1.0, ..SensorModel::unknown() }
}

/// Returns the variants of these nodes: the nodes themselves, and for streams that no node makes, such as merged captures and what the `method`
/// `spud_as_published` recovers, the detector behind a maker. `streams`: those that are wanted.
///
/// # Errors
/// [`GridError`] of a method that the paper does not have, and of nodes without a camera and a detector.
pub fn variants(
    nodes: Vec<PlannedNode>,
    (method, is_paper): (&str, bool),
    streams: Option<&[String]>,
) -> Result<Vec<Variant>, GridError> {
    let is_wanted = |stream: &&str| streams.is_none_or(|streams| streams.iter().any(|other| other == stream));
    if is_paper {
        let maker = PAPER.iter().find(|(_, own)| *own == method).map(|(executable, _)| *executable);
        let maker =
            maker.ok_or_else(|| GridError::value("method", method, "one of spud_as_published, spud"))?;
        let streams = OF_PAPER.into_iter().filter(is_wanted).collect();
        return Ok(vec![made_by(maker, &nodes, streams, true)?]);
    }
    // Of all streams of a launch file, these have to be asked for.
    let brackets = BRACKETS.into_iter().filter(|stream| streams.is_some() && is_wanted(stream));
    let mut makers: Vec<(&'static str, &'static str)> = brackets.map(|stream| (stream, stream)).collect();
    if method == SPUD_AS_PUBLISHED && is_wanted(&"recovered") {
        makers.push((SPUD_AS_PUBLISHED, "recovered"));
    }
    let made = makers.iter().map(|(maker, stream)| made_by(maker, &nodes, vec![*stream], false));
    let mut variants = made.collect::<Result<Vec<_>, _>>()?;
    let is_made = |stream: &str| {
        makers.iter().any(|(_, own)| *own == stream) || method == SPUD_AS_PUBLISHED && stream == "metered"
    };
    let wanted =
        streams.map(|streams| streams.iter().filter(|stream| !is_made(stream)).cloned().collect::<Vec<_>>());
    let is_whole = wanted.is_none() && makers.is_empty();
    if is_whole || wanted.as_ref().is_some_and(|wanted| !wanted.is_empty()) {
        variants.push(Variant { nodes, wanted, more: BTreeMap::new() });
    }
    Ok(variants)
}

/// `maker` in the place of the camera and the unwrapping, and a detector as those of `nodes` for each of its `streams`.
fn made_by(
    maker: &'static str,
    nodes: &[PlannedNode],
    streams: Vec<&str>,
    is_paper: bool,
) -> Result<Variant, GridError> {
    let first = |executable: &str| {
        let found = nodes.iter().find(|node| node.executable == executable).cloned();
        found.ok_or_else(|| GridError::Request(format!("the launch file has no {executable}")))
    };
    let (mut camera, detector) = (first(CAMERA)?, first(DETECTOR)?);
    camera.executable = maker;
    let sensor = CameraParameters::from(&camera.parameters).sensor;
    // Makers have three chips with one gain.
    let sensor = if is_paper { sensor_of_paper(sensor.alpha) } else { sensor.reset(&["mosaic", "gains"]) };
    camera.parameters = camera.parameters.with_text(
        &sensor.to_text().into_iter().map(|(name, text)| (name.to_owned(), text)).collect::<Vec<_>>(),
    )?;
    let mut made = vec![camera];
    for stream in streams {
        let name = NodeName { name: format!("detector_{stream}"), ..detector.name.clone() };
        let input = if BRACKETS.contains(&stream) { format!("/{stream}") } else { stream.to_owned() };
        let parameters = detector.parameters.with_text(&[("input", input.as_str()), ("cameras", "[]")])?;
        made.push(PlannedNode { executable: DETECTOR, name, parameters });
    }
    let protocol = is_paper.then(|| ("protocol".to_owned(), "paper".to_owned()));
    Ok(Variant { nodes: made, wanted: None, more: protocol.into_iter().collect() })
}

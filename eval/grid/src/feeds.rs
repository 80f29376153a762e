//! [`feeds`]: the frames of each camera, with the cells that see them.

use modulo_bags::source::SourceOptions;
use modulo_camera::CameraParameters;
use sha2::{Digest as _, Sha256};

use crate::GridError;
use crate::data::Data;
use crate::frames::Frames;
use crate::plan::Cell;

/// The frames of one camera, with the cells that see them.
pub struct Feed<'a> {
    /// The name of its files.
    pub name: String,
    /// Its frames.
    pub frames: Frames,
    /// Its cells.
    pub cells: Vec<Cell<'a>>,
}

/// Opens the frames of each camera of `cells`.
///
/// # Errors
/// [`GridError`] of a source that cannot be read, or of frames that do not fit the streams.
pub fn feeds<'a>(cells: Vec<Cell<'a>>, data: Option<&Data>) -> Result<Vec<Feed<'a>>, GridError> {
    let mut feeds: Vec<Feed<'a>> = Vec::new();
    let is_same_mosaic = |one: &Cell<'_>| {
        cells
            .iter()
            .filter(|cell| cell.camera.name == one.camera.name)
            .all(|cell| camera(cell).sensor.mosaic == camera(one).sensor.mosaic)
    };
    let options: Vec<SourceOptions> = cells
        .iter()
        .map(|cell| {
            let mut coding = camera(cell).coding()?;
            // A raw mosaic can be seen by a sensor with the same colour filters only, and so by no other cell.
            coding.mosaic = coding.mosaic.filter(|_| is_same_mosaic(cell));
            Ok(SourceOptions { coding, topic: None })
        })
        .collect::<Result<_, GridError>>()?;
    for (cell, options) in cells.into_iter().zip(options) {
        let parameters = camera(&cell);
        let own = data.cloned().unwrap_or_else(|| Data::Own(Box::new(parameters)));
        let read = format!("{options:?}");
        let name = format!(
            "{}-{}",
            cell.camera.name.trim_start_matches('/').replace('/', "_"),
            &modulo_models::hex(&Sha256::digest(read))[..8]
        );
        match feeds.iter_mut().find(|feed| feed.name == name) {
            Some(feed) => feed.cells.push(cell),
            None => feeds.push(Feed { name, frames: Frames::open(&own, &options)?, cells: vec![cell] }),
        }
    }
    Ok(feeds)
}

/// The parameters of the camera of a cell.
fn camera(cell: &Cell<'_>) -> CameraParameters {
    (&cell.variant.nodes[cell.camera.member].parameters).into()
}

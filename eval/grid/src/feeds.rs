//! [`feeds`]: the frames of each camera, with the cells that see them.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_bags::source::SourceOptions;
use modulo_runtime::input::in_home;
use sha2::{Digest as _, Sha256};

use crate::GridError;
use crate::data::DataOptions;
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

/// Opens the frames of each camera of `cells`, reads their models, and notes both in the keys of the cells.
pub fn feeds<'a>(mut cells: Vec<Cell<'a>>, data: &DataOptions) -> Result<Vec<Feed<'a>>, GridError> {
    note_models(&mut cells)?;
    let mosaic = |cell: &Cell<'_>| (cell.camera().name.clone(), cell.sensing().sensor.mosaic);
    let mosaics: Vec<_> = cells.iter().map(mosaic).collect();
    let mut feeds: Vec<Feed<'a>> = Vec::new();
    for mut cell in cells {
        let (camera, (name, own)) = (cell.sensing(), mosaic(&cell));
        let mut coding = camera.coding()?;
        // A raw mosaic can be seen by a sensor with the same colour filters only, and so by no other cell.
        if mosaics.iter().any(|(of, other)| *of == name && *other != own) {
            coding.mosaic = None;
        }
        let options = SourceOptions { coding, topic: None };
        let read = modulo_models::hex(&Sha256::digest(format!("{options:?}")));
        let name = name.fully_qualified().trim_start_matches('/').replace('/', "_");
        let name = format!("{name}-{}", &read[..8]);
        cell.key.frames.clone_from(&name);
        match feeds.iter_mut().find(|feed| feed.name == name) {
            Some(feed) => feed.cells.push(cell),
            None => feeds.push(Feed { name, frames: data.open(&camera, &options)?, cells: vec![cell] }),
        }
    }
    Ok(feeds)
}

/// Notes the sha256 of the model of each cell. Two files of one name would share their cells.
fn note_models(cells: &mut [Cell<'_>]) -> Result<(), GridError> {
    let mut models: BTreeMap<String, (String, String)> = BTreeMap::new();
    for cell in cells {
        let (name, file) = (&cell.key.point.model, cell.detecting().model);
        if !models.contains_key(name) {
            models.insert(name.clone(), (file.clone(), sha256(&in_home(Path::new(&file)))?));
        }
        let (known, hash) = &models[name];
        if *known != file {
            return Err(GridError::value("model", format!("twice {name}"), "one file for each name"));
        }
        cell.key.model.clone_from(hash);
    }
    Ok(())
}

fn sha256(model: &Path) -> Result<String, GridError> {
    let refused = |why| {
        GridError::value("--model", model.display(), format!("demo or a file that can be read ({why})"))
    };
    let parts = modulo_detector::model_parts(model).map_err(refused)?;
    // As `cat model.onnx model.onnx.data | sha256sum` gives it.
    let hash = parts.iter().fold(Sha256::new(), |hash, (_, bytes)| hash.chain_update(bytes));
    Ok(modulo_models::hex(&hash.finalize()))
}

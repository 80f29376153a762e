//! [`models`]: the models of cells, each with its hash.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_detector::DetectorParameters;
use modulo_runtime::input::in_home;
use sha2::{Digest as _, Sha256};

use crate::GridError;
use crate::plan::Cell;

/// The file and the sha256 of each model, by its name in cells.
pub type Models = BTreeMap<String, (String, String)>;

/// Reads the models of `cells`.
///
/// # Errors
/// [`GridError::Request`] of a model that cannot be read, and of two files of one name.
pub fn models(cells: &[Cell<'_>]) -> Result<Models, GridError> {
    let mut models = Models::new();
    for cell in cells {
        let detector = cell.stream.way.last().expect("a way ends at a detector");
        let DetectorParameters { model, .. } = (&cell.variant.nodes[*detector].parameters).into();
        match models.get(&cell.point.model) {
            // Two files of one name would share their cells.
            Some((other, _)) if *other != model => {
                return Err(GridError::value(
                    "model",
                    format!("twice {}", cell.point.model),
                    "one file for each name",
                ));
            }
            Some(_) => {}
            None => {
                let digest = sha256(&in_home(Path::new(&model)))?;
                models.insert(cell.point.model.clone(), (model, digest));
            }
        }
    }
    Ok(models)
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

//! Where packages lie: the suite itself in its checkout or beside its binary,
//! all others where ROS 2 installed them.

use std::path::{Path, PathBuf};

use super::{SubstitutionError, Surroundings};

/// The package that this suite is.
pub const SUITE: &str = "modulo";

/// A file by which the suite's own share folder is known.
const MARKER: &str = "launch/suite.launch.yaml";

/// `share/<package>` of a package; for the suite the folder that holds `launch/`.
///
/// # Errors
/// [`SubstitutionError`] with the places that were looked at.
pub(crate) fn share(package: &str, around: &Surroundings<'_>) -> Result<PathBuf, SubstitutionError> {
    if package == SUITE
        && let Some(root) = suite_roots(around.file).into_iter().find(|root| root.join(MARKER).is_file())
    {
        return Ok(root);
    }
    Ok(installed(package, around)?.join("share").join(package))
}

/// The prefix under which a package is installed; for the suite in a checkout
/// the checkout.
///
/// # Errors
/// [`SubstitutionError`] with the places that were looked at.
pub(super) fn prefix(package: &str, around: &Surroundings<'_>) -> Result<PathBuf, SubstitutionError> {
    if package != SUITE {
        return installed(package, around);
    }
    let share = share(package, around)?;
    let installed = share.ends_with(Path::new("share").join(SUITE));
    Ok(share.ancestors().nth(if installed { 2 } else { 0 }).unwrap_or(&share).to_owned())
}

/// Where the suite's share folder may be, the likeliest first.
fn suite_roots(file: &Path) -> Vec<PathBuf> {
    let beside_the_file = file.parent().and_then(Path::parent).map(Path::to_owned);
    let binary = std::env::current_exe().and_then(|exe| exe.canonicalize()).unwrap_or_default();
    let above_the_binary = binary.ancestors().skip(1);
    beside_the_file
        .into_iter()
        .chain(above_the_binary.flat_map(|dir| [dir.join("share").join(SUITE), dir.to_owned()]))
        .collect()
}

fn installed(package: &str, around: &Surroundings<'_>) -> Result<PathBuf, SubstitutionError> {
    let path = around.environment.get("AMENT_PREFIX_PATH").map_or("", String::as_str);
    let prefixes: Vec<&str> = path.split(':').filter(|prefix| !prefix.is_empty()).collect();
    let found = prefixes.iter().map(Path::new).find(|prefix| prefix.join("share").join(package).is_dir());
    if let (Some(prefix), false) = (found, package.is_empty() || package.contains('/')) {
        return Ok(prefix.to_owned());
    }
    let places = match (prefixes.is_empty(), package == SUITE) {
        (true, true) => "looked beside the launch file, above the binary and in AMENT_PREFIX_PATH".to_owned(),
        (true, false) => "looked in AMENT_PREFIX_PATH, which is empty".to_owned(),
        (false, _) => {
            let places: Vec<String> = prefixes.iter().map(|p| format!("{p}/share/{package}")).collect();
            format!("looked at {}", places.join(", "))
        }
    };
    Err(SubstitutionError::Invalid(format!("package '{package}' is not found, {places}")))
}

//! Composes a frame from background, shadows, objects from far to near, and stray light, and derives the ground
//! truth from the objects' layers.

use super::background::{Street, Tunnel};
use super::hash::{Random, hash, wave};
use super::layer::{Layer, OWNED};
use super::light::{Light, add, scaled};
use super::solid::Halo;
use super::traffic::{Actor, actors};
use super::view::{CameraView, NEAR};
use super::{Class, Preset, Rendered, Scene, SceneObject};
use modulo_core::BBox;
use ndarray::Array3;

/// An actor with its painted layer and the box of all of it, in the image or not.
struct Painted<'a> {
    actor: &'a Actor,
    layer: Layer,
    whole: BBox,
}

impl Scene {
    /// Renders frame `frame`, of 30 a second, at `height` x `width` pixels; a side of 0 counts as 1.
    pub fn render(&self, frame: u32, height: usize, width: usize) -> Rendered {
        let (scene, height, width) = (self, height.max(1), width.max(1));
        // Both halves of the seed count, and a constant keeps scenes apart from other users of the hash.
        let seed = hash(scene.seed as u32, (scene.seed >> 32) as u32, 0xB0A7);
        let view = CameraView::new(seed, frame, height, width);
        let (exit, sun) = exit_and_sun(scene.preset, seed, frame, &view);
        let light = Light::new(scene.preset, exit, sun, &view);
        let actors = actors(scene.preset, seed, frame, light.lamps());
        let mut radiance = background(scene.preset, seed, frame, exit, &view, &light);
        // All shadows come before all actors, so that no shadow darkens an actor that stands in front of it.
        for actor in &actors {
            shadow(&mut radiance, actor, &view);
        }
        let painted: Vec<Painted> = actors
            .iter()
            .filter_map(|actor| {
                actor.solid.layer(&view, &light).map(|(layer, whole)| Painted { actor, layer, whole })
            })
            .collect();
        // From far to near, each with its halos, so that a nearer actor also hides the lamps of a farther one.
        for p in &painted {
            cover(&mut radiance, &p.layer);
            for halo in p.actor.solid.halos() {
                shine(&mut radiance, halo, &view, 1.0);
                if scene.preset == Preset::Sunset {
                    // The wet street draws the reflection of a lamp long.
                    let at = [halo.at[0], -halo.at[1], halo.at[2]];
                    shine(&mut radiance, &Halo { at, glow: scaled(halo.glow, 0.30), ..*halo }, &view, 2.5);
                }
            }
        }
        finish(&mut radiance, &light);
        Rendered { radiance, objects: truth(&painted, &view) }
    }
}

/// Returns the distance of the tunnel's exit in m and the position of the low sun in px.
fn exit_and_sun(preset: Preset, seed: u32, frame: u32, view: &CameraView) -> (f32, [f32; 2]) {
    let mut random = Random::new(seed, 2);
    // The number wraps before it becomes a float, which would lose the small steps of a long drive.
    let time = (frame % 36_000) as f32;
    let exit = random.between(27.0, 33.0) + 6.0 * wave(time / 600.0 + random.unit());
    let s = view.scale();
    let (across, up) = (random.between(-60.0, 60.0), random.between(16.0, 34.0));
    let sun = match preset {
        Preset::Sunset => [view.cx + 0.3 * s * across, view.cy - 0.7 * s * up],
        _ => [view.cx + s * across, view.cy - s * up],
    };
    (exit, sun)
}

fn background(
    preset: Preset,
    seed: u32,
    frame: u32,
    exit: f32,
    view: &CameraView,
    light: &Light,
) -> Array3<f32> {
    let size = (view.height, view.width);
    if preset == Preset::Tunnel {
        let tunnel = Tunnel { view, light, exit, driven: (frame % 60_000) as f32 * 0.16, seed };
        return fill(size, |row, column| tunnel.radiance(row, column));
    }
    let street = Street::new(view, light, preset, seed, frame);
    fill(size, |row, column| street.radiance(row, column))
}

fn fill((height, width): (usize, usize), pixel: impl Fn(usize, usize) -> [f32; 3]) -> Array3<f32> {
    let mut image = Array3::zeros((height, width, 3));
    each_pixel(&mut image, |texel, row, column| texel.copy_from_slice(&pixel(row, column)));
    image
}

/// Calls `change` with each pixel's three samples, its row and its column.
fn each_pixel(image: &mut Array3<f32>, change: impl Fn(&mut [f32], usize, usize)) {
    let width = image.dim().1;
    let samples = image.as_slice_mut().expect("`fill` makes the layout standard");
    samples.chunks_exact_mut(3).enumerate().for_each(|(i, texel)| change(texel, i / width, i % width));
}

/// Darkens the ground below an actor by an ellipse with a soft edge.
fn shadow(image: &mut Array3<f32>, actor: &Actor, view: &CameraView) {
    let [x, z, half, long] = actor.ground;
    let (near, far) = (z - long, z + long);
    // Ground that reaches the near plane has no finite extent in the image.
    if near < NEAR {
        return;
    }
    let s = view.focal / near;
    let reach = (half * 1.3 + 0.1) * s;
    let (left, right) =
        (view.project([x, 0.0, z])[0] - reach - s * 0.3, view.project([x, 0.0, near])[0] + reach + s * 0.3);
    let (top, bottom) =
        (view.project([x, 0.0, far + 1.0])[1], view.project([x, 0.0, (near - 0.6).max(NEAR)])[1]);
    let rows = span(top, bottom, view.height);
    let columns = span(left.min(right - 3.0 * reach), right.max(left + 3.0 * reach), view.width);
    for row in rows {
        let below = row as f32 + 0.5 - view.cy;
        if below <= 0.0 {
            continue;
        }
        let depth = view.focal * super::view::CAMERA_HEIGHT / below;
        let dz = (depth - z) / (long + 0.5);
        for column in columns.clone() {
            let dx = ((column as f32 + 0.5 - view.cx) * depth / view.focal - x) / (half * 1.25 + 0.1);
            // Fourth powers give a rounded rectangle, as a car covers the ground.
            let r2 = dx * dx * dx * dx + dz * dz * dz * dz;
            let shade = 1.0 - 0.62 * (1.0 - super::hash::ramp(0.25, 1.3, r2));
            (0..3).for_each(|c| image[[row, column, c]] *= shade);
        }
    }
}

fn span(from: f32, to: f32, end: usize) -> std::ops::Range<usize> {
    let cut = |x: f32| x.clamp(0.0, end as f32) as usize;
    cut(from)..cut(to + 1.0)
}

/// Paints a layer over the image.
fn cover(image: &mut Array3<f32>, layer: &Layer) {
    for row in 0..layer.height {
        for column in 0..layer.width {
            let texel = layer.texels[row * layer.width + column];
            if texel[3] > 0.0 {
                let at = |c| [row + layer.top, column + layer.left, c];
                // The colour of a texel contains its coverage already, so only the background is weighted.
                (0..3).for_each(|c| image[at(c)] = image[at(c)] * (1.0 - texel[3]) + texel[c]);
            }
        }
    }
}

/// Adds the halo of a lamp: A (1 - r^2 / 16)^2 / (1 + r^2), zero from r = 4 on, and `stretch` times as high as wide.
fn shine(image: &mut Array3<f32>, halo: &Halo, view: &CameraView, stretch: f32) {
    // The size of a lamp in the image grows without bound towards the camera.
    if halo.at[2] < NEAR {
        return;
    }
    let [u, v] = view.project(halo.at);
    let size = view.focal / halo.at[2] * halo.radius;
    let radius = size.max(3.0 * view.scale());
    // A lamp smaller than a pixel keeps its energy: it is drawn larger and darker.
    let glow = scaled(halo.glow, (size / radius + 0.25).min(1.0));
    let (height, width, _) = image.dim();
    let reach = 4.0 * radius * stretch;
    for row in span(v - reach, v + reach, height) {
        for column in span(u - 4.0 * radius, u + 4.0 * radius, width) {
            let (x, y) = ((column as f32 + 0.5 - u) / radius, (row as f32 + 0.5 - v) / radius / stretch);
            let r2 = x * x + y * y;
            let rim = (1.0 - r2 / 16.0).max(0.0);
            let share = rim * rim / (1.0 + r2);
            (0..3).for_each(|c| image[[row, column, c]] += glow[c] * share);
        }
    }
}

/// Adds stray light everywhere, then compresses the top of the range.
fn finish(image: &mut Array3<f32>, light: &Light) {
    each_pixel(image, |texel, row, column| {
        let veil = light.veil(column as f32 + 0.5, row as f32 + 0.5);
        let seen = add([texel[0], texel[1], texel[2]], veil);
        texel.copy_from_slice(&seen.map(Light::shoulder));
    });
}

/// Returns the ground truth from far to near. It goes from near to far and marks the pixels that are taken.
fn truth(painted: &[Painted], view: &CameraView) -> Vec<SceneObject> {
    let mut covered = vec![false; view.height * view.width];
    let mut found: Vec<SceneObject> = painted
        .iter()
        .rev()
        .filter_map(|p| {
            let occlusion = take(&mut covered, &p.layer, view.width);
            object(p.actor.class?, p, occlusion, view)
        })
        .collect();
    // Near actors take their pixels first, but the list runs from far to near.
    found.reverse();
    found
}

fn object(class: Class, p: &Painted, occlusion: f32, view: &CameraView) -> Option<SceneObject> {
    let bbox = p.layer.extent()?;
    // The share is that of the boxes and not of the pixels: what lies outside of the image was never painted.
    let inside = p.whole.clamp(view.height, view.width);
    // A box without area would divide by 0.
    let truncation = (1.0 - inside.area() / p.whole.area().max(1e-6)).clamp(0.0, 1.0);
    Some(SceneObject { class, bbox, occlusion, truncation })
}

/// Marks the pixels of a layer as taken, and returns the share of them that was taken before.
fn take(covered: &mut [bool], layer: &Layer, width: usize) -> f32 {
    let (mut own, mut hidden) = (0u32, 0u32);
    for (i, texel) in layer.texels.iter().enumerate() {
        if texel[3] >= OWNED {
            let at = (layer.top + i / layer.width) * width + layer.left + i % layer.width;
            own += 1;
            hidden += u32::from(std::mem::replace(&mut covered[at], true));
        }
    }
    if own == 0 { 0.0 } else { hidden as f32 / own as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the extent of the pixels that differ by at least half between a black and a white background
    /// without other actors.
    fn seen_alone(p: &Painted, view: &CameraView) -> Option<BBox> {
        let alone = |ground: f32| {
            let mut image = Array3::from_elem((view.height, view.width, 3), ground);
            cover(&mut image, &p.layer);
            image
        };
        let (black, white) = (alone(0.0), alone(1.0));
        let mut found: Option<BBox> = None;
        for ((y, x, c), b) in black.indexed_iter() {
            if c == 0 && 1.0 - (white[[y, x, 0]] - b) >= 0.5 {
                let (x, y) = (x as f32, y as f32);
                let pixel = BBox { x1: x, y1: y, x2: x + 1.0, y2: y + 1.0 };
                found = Some(found.map_or(pixel, |all| crate::layer::join(all, pixel)));
            }
        }
        found
    }

    #[test]
    fn boxes_are_the_extent_of_each_object_alone() {
        let view = CameraView::new(3, 0, 96, 320);
        let light = Light::new(Preset::Day, 30.0, [0.0; 2], &view);
        let actors = actors(Preset::Day, 3, 40, light.lamps());
        let mut checked = 0;
        for actor in &actors {
            let Some((layer, whole)) = actor.solid.layer(&view, &light) else { continue };
            let p = Painted { actor, layer, whole };
            let Some(found) = object(Class::Car, &p, 0.0, &view) else { continue };
            assert_eq!(Some(found.bbox), seen_alone(&p, &view));
            let inside = whole.x1 >= 0.0 && whole.x2 <= 320.0 && whole.y1 >= 0.0 && whole.y2 <= 96.0;
            assert_eq!(found.truncation == 0.0, inside, "{whole:?}");
            checked += 1;
        }
        assert!(checked >= 8, "only {checked} objects");
    }

    #[test]
    fn occlusion_counts_what_nearer_things_took() {
        let full =
            |left: usize| Layer { left, top: 0, width: 4, height: 2, texels: vec![[0.0, 0.0, 0.0, 1.0]; 8] };
        let mut covered = vec![false; 2 * 16];
        assert_eq!(take(&mut covered, &full(0), 16), 0.0);
        assert_eq!(take(&mut covered, &full(3), 16), 0.25);
        assert_eq!(take(&mut covered, &full(1), 16), 1.0);
    }
}

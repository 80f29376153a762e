//! The scenery that stands still behind the traffic: [`Street`], with sky, houses, pavement and road, and [`Tunnel`].
//!
//! One ray per pixel meets a corridor of planes. Values that depend only on the column or only on the row of a street
//! are computed once.

use super::Preset;
use super::hash::{hash, mix, noise, ramp, unit};
use super::light::{Light, Rgb, add, blend, scaled};
use super::view::{CAMERA_HEIGHT, CameraView};

/// The positions of the rows of houses in m.
const ROWS: [f32; 2] = [-10.5, 10.0];
/// The width of a house in m.
const HOUSE: f32 = 11.0;
/// The distance from window to window in m.
const BAY: f32 = 2.2;
/// The distance in m that the camera drives in a frame.
const STEP: f32 = 0.16;

/// The houses in one column of the image.
struct Column {
    /// The distance in m.
    z: f32,
    /// The number of the house, different on either side.
    house: u32,
    /// The position along the house in m.
    along: f32,
    /// The height of the house in m.
    high: f32,
    /// The reflectance of its plaster.
    plaster: Rgb,
    /// The size of a pixel in bays of windows.
    soft: f32,
    /// The share of a window in this column, 0 to 1.
    wide: f32,
    /// The contrast of windows at this distance, 0 to 1.
    fade: f32,
    /// The normal of the wall, which points to the street.
    facing: f32,
    /// The height of the far skyline in px above the horizon.
    skyline: f32,
}

/// The open street of one frame without traffic: the ground, and a row of houses on either side.
pub(super) struct Street<'a> {
    view: &'a CameraView,
    light: &'a Light,
    preset: Preset,
    seed: u32,
    columns: Vec<Column>,
    /// The distance driven in m.
    driven: f32,
}

impl<'a> Street<'a> {
    /// Makes the street of `frame`.
    pub(super) fn new(view: &'a CameraView, light: &'a Light, preset: Preset, seed: u32, frame: u32) -> Self {
        // The number wraps, because positions lose their digits in `f32` on a long drive.
        let driven = (frame % 60_000) as f32 * STEP;
        let columns = (0..view.width).map(|c| column(view, seed, driven, c as f32 + 0.5)).collect();
        Self { view, light, preset, seed, columns, driven }
    }

    /// Returns the radiance at a pixel.
    pub(super) fn radiance(&self, row: usize, column: usize) -> Rgb {
        let (u, v) = (column as f32 + 0.5, row as f32 + 0.5);
        let at = &self.columns[column];
        // Rows are compared with the horizon, since only rays below it meet the ground.
        let below = v - self.view.cy;
        let ground = if below > 0.0 { self.view.focal * CAMERA_HEIGHT / below } else { f32::MAX };
        // The nearer of ground and wall is the visible one; beyond 400 m the far skyline takes over.
        if ground < at.z.min(400.0) {
            return self.ground(u, ground);
        }
        let up = CAMERA_HEIGHT - below * at.z / self.view.focal;
        let pixel = at.z / self.view.focal;
        let roof = ramp(-1.2 * pixel, 1.2 * pixel, at.high - up);
        // Most pixels are on one side of the roof line and need one surface only.
        if roof == 1.0 {
            return self.wall(at, up);
        }
        let far = self.far(u, v, at);
        if roof == 0.0 { far } else { blend(far, self.wall(at, up), roof) }
    }

    /// Returns the radiance of sky, clouds and the skyline at the end of the street.
    fn far(&self, u: f32, v: f32, at: &Column) -> Rgb {
        let (view, sky) = (self.view, self.light.sky(u, v, self.view));
        let above = view.cy - v;
        let s = view.scale();
        let cloud = ramp(0.45, 0.85, noise(u / (70.0 * s) + 9.0, above / (16.0 * s), self.seed));
        let cloudy = match self.preset {
            Preset::Sunset => self.streaks(sky, u, above),
            Preset::Night => add(sky, scaled([0.012, 0.010, 0.010], cloud)),
            Preset::Glare => add(sky, scaled([0.07, 0.05, 0.03], cloud)),
            _ => blend(sky, [0.44, 0.45, 0.46], cloud * ramp(0.0, 30.0 * s, above)),
        };
        let hill = ramp(-1.5, 1.5, at.skyline * s - above);
        blend(cloudy, self.light.shade([0.16, 0.18, 0.16], [0.0, 0.6, -0.8], 240.0), hill)
    }

    /// Returns the radiance of a house wall at height `up` in m.
    fn wall(&self, at: &Column, up: f32) -> Rgb {
        let floor = (up / 3.1).floor();
        let (fy, soft) = (up / 3.1 - floor, at.soft);
        let tall = ramp(0.25 - soft, 0.25 + soft, fy) * ramp(0.18 - soft, 0.18 + soft, 1.0 - fy);
        // Windows smaller than a pixel would flicker, so far away they fade into their mean share of the wall.
        let window = mix(0.35, at.wide * tall, at.fade) * (1.0 - ramp(-0.6, 0.4, up - at.high + 1.0));
        let grain = 0.9 + 0.2 * noise(at.along * 1.7, up * 1.7, at.house);
        let normal = [at.facing, 0.0, 0.0];
        let plain = self.light.shade(scaled(at.plaster, grain), normal, at.z);
        let pane = self.light.shade([0.10, 0.12, 0.14], normal, at.z);
        blend(plain, add(pane, self.lit(at, floor)), window)
    }

    /// Returns the sky with long thin clouds that the setting sun shines at from below.
    fn streaks(&self, sky: Rgb, u: f32, above: f32) -> Rgb {
        let s = self.view.scale();
        let slow = noise(u / (120.0 * s) + 3.0, above / (15.0 * s), self.seed);
        let fine = noise(u / (41.0 * s), above / (5.5 * s) + 5.0, self.seed ^ 3);
        let cloud = ramp(0.38, 0.80, 0.72 * slow + 0.28 * fine) * ramp(0.0, 26.0 * s, above);
        add(scaled(sky, 1.0 - 0.30 * cloud), scaled([0.105, 0.044, 0.030], cloud))
    }

    /// Returns the light behind a window, at night and at sunset.
    fn lit(&self, at: &Column, floor: f32) -> Rgb {
        if !matches!(self.preset, Preset::Night | Preset::Sunset) {
            return [0.0; 3];
        }
        // Chance depends on house, floor and bay, so that a lit window stays lit in all frames.
        let bay = (at.along / BAY).floor() as i32 as u32;
        let chance = unit(hash(at.house, hash(floor as i32 as u32, bay, 5), self.seed));
        scaled([0.13, 0.10, 0.055], if chance < 0.22 { at.fade } else { 0.05 })
    }

    fn ground(&self, u: f32, z: f32) -> Rgb {
        let x = (u - self.view.cx) * z / self.view.focal;
        let pixel = z / self.view.focal;
        let albedo = road(x, z + self.driven, z * pixel / CAMERA_HEIGHT, pixel, [-8.4, 8.0], self.seed);
        let lit = self.light.shade(albedo, [0.0, 1.0, 0.0], z);
        match self.preset {
            Preset::Glare => add(lit, self.glitter(u, z)),
            Preset::Sunset => self.wet(lit, u, x, z),
            _ => lit,
        }
    }

    /// Returns the radiance of wet ground, which mirrors sky and houses by Schlick's approximation of Fresnel's equations.
    fn wet(&self, lit: Rgb, u: f32, x: f32, z: f32) -> Rgb {
        let along = z + self.driven;
        let cosine = CAMERA_HEIGHT / (CAMERA_HEIGHT * CAMERA_HEIGHT + z * z).sqrt();
        let graze = 1.0 - cosine;
        let fresnel = 0.03 + 0.97 * graze * graze * graze * graze * graze;
        let puddle = ramp(0.30, 0.62, noise(x * 0.55, along * 0.13, self.seed ^ 17));
        let s = self.view.scale();
        let ripple = (noise(x * 2.3, along * 0.9, self.seed ^ 19) - 0.5) * (1.0 - puddle) * 16.0 * s;
        // The mirrored ray leaves the ground at the angle at which the ray of the pixel meets it.
        let above = (self.view.focal * CAMERA_HEIGHT / z + ripple).max(1.0);
        let at = &self.columns[(u as usize).min(self.columns.len() - 1)];
        let up = above * at.z / self.view.focal - CAMERA_HEIGHT;
        let sky = self.far(u, self.view.cy - above, at);
        let mirrored = match at.z.min(400.0) {
            wall if wall > z => blend(sky, self.wall(at, up.max(0.0)), ramp(-1.0, 1.0, at.high - up)),
            _ => sky,
        };
        let share = fresnel * mix(0.45, 0.95, puddle);
        // Wet asphalt is darker by itself.
        blend(scaled(lit, 0.65), mirrored, share)
    }

    /// Returns the reflection of the low sun in the road.
    fn glitter(&self, u: f32, z: f32) -> Rgb {
        let s = self.view.scale();
        let [x, _] = self.light.glare;
        let off = (u - x) / (95.0 * s);
        scaled([0.30, 0.26, 0.19], ramp(4.0, 30.0, z) / (1.0 + off * off))
    }
}

/// Returns the reflectance of the ground at `x` to the right and `along` the street in m; `deep` and `pixel` are
/// the size of a pixel along and across, `kerbs` the ends of the road.
fn road(x: f32, along: f32, deep: f32, pixel: f32, kerbs: [f32; 2], seed: u32) -> Rgb {
    let fade = 1.0 - ramp(0.2, 1.5, deep);
    let grain = 0.15 * (noise(x * 2.5, along * 0.8, seed) - 0.5)
        + 0.22 * (noise(x * 0.5, along * 0.11, seed ^ 1) - 0.5);
    let asphalt = scaled([0.225, 0.225, 0.235], 1.0 + grain * (0.4 + 0.6 * fade));
    let band = |middle: f32, half: f32| ramp(-pixel, pixel, half - (x - middle).abs());
    let dash = {
        let t = along / 9.0 - (along / 9.0).floor();
        // A dash is as soft as a pixel is long, or far dashes would flicker.
        let soft = (deep / 9.0).clamp(0.01, 0.5);
        mix(0.4, ramp(-soft, soft, 0.4 - (t - 0.5).abs() * 2.0), fade.max(0.2))
    };
    // Markings fade with distance, where they are thinner than a pixel.
    let paint = (band(-1.85, 0.09) * dash).max(band(2.75, 0.07)).max(band(-5.2, 0.07));
    let marked = blend(asphalt, [0.74, 0.74, 0.72], 0.85 * paint);
    let outside = ramp(-pixel, pixel, kerbs[0] + 2.0 - x).max(ramp(-pixel, pixel, x - kerbs[1] + 2.9));
    // Pavement needs one more noise, which most pixels of the road save.
    if outside == 0.0 {
        return marked;
    }
    let slab = 1.0 + 0.12 * fade * (noise(x * 1.4, along * 1.4, seed ^ 2) - 0.5);
    blend(marked, scaled([0.36, 0.35, 0.33], slab), outside)
}

fn column(view: &CameraView, seed: u32, driven: f32, u: f32) -> Column {
    let slope = (u - view.cx) / view.focal;
    let side = usize::from(slope > 0.0);
    // A ray straight along the street meets no house, so the distance is bounded.
    let z = (ROWS[side] / slope).abs().min(900.0);
    let along = (z + driven) / HOUSE;
    let number = along.floor();
    let house = hash(number as i32 as u32, side as u32, seed);
    // A low wall in place of some houses lets the sky in, as side streets do.
    let gap = unit(hash(house, 40, 0)) < 0.22;
    let high = if gap { 0.9 } else { 5.0 + 9.0 * unit(hash(house, 41, 0)) };
    let skyline =
        4.0 + 14.0 * noise(u / view.scale() / 34.0, 0.0, seed) * noise(u / view.scale() / 9.0, 3.0, seed);
    let facing = if side == 0 { 1.0 } else { -1.0 };
    let along = (along - number) * HOUSE;
    let tint = |k: u32| 0.22 + 0.30 * unit(hash(house, k, seed));
    let base = tint(1);
    let plaster = [base * 1.05, base * (0.86 + 0.2 * tint(2)), base * (0.66 + 0.6 * tint(3))];
    let fx = along / BAY - (along / BAY).floor();
    let soft = (z / view.focal / BAY).max(0.02);
    let wide = ramp(0.22 - soft, 0.22 + soft, fx) * ramp(0.22 - soft, 0.22 + soft, 1.0 - fx);
    let fade = 1.0 - ramp(0.25, 0.9, soft);
    Column { z, house, along, high, plaster, soft, wide, fade, facing, skyline }
}

/// The positions of the left and the right wall in m.
const WALLS: [f32; 2] = [-6.8, 6.3];
/// The height of the ceiling in m.
const CEILING: f32 = 5.4;

/// The tunnel of one frame without traffic: dark walls, a row of weak lamps, and the open exit, whose light reaches far
/// inside.
pub(super) struct Tunnel<'a> {
    pub(super) view: &'a CameraView,
    pub(super) light: &'a Light,
    /// The distance of the open exit in m.
    pub(super) exit: f32,
    /// The distance driven in m.
    pub(super) driven: f32,
    pub(super) seed: u32,
}

impl Tunnel<'_> {
    /// Returns the radiance at a pixel.
    pub(super) fn radiance(&self, row: usize, column: usize) -> Rgb {
        let (u, v) = (column as f32 + 0.5, row as f32 + 0.5);
        let (sx, sy) = ((u - self.view.cx) / self.view.focal, (self.view.cy - v) / self.view.focal);
        // A ray straight ahead meets no wall; the small number keeps its distance finite.
        let wall = if sx > 0.0 { WALLS[1] / sx } else { WALLS[0] / sx.min(-1e-6) };
        let flat =
            if sy > 0.0 { (CEILING - CAMERA_HEIGHT) / sy.max(1e-6) } else { CAMERA_HEIGHT / (-sy).max(1e-6) };
        // The nearest plane along the ray is the visible one.
        let z = wall.min(flat).min(400.0);
        if flat <= wall && sy <= 0.0 {
            return self.floor(sx * z, z);
        }
        let inside = self.lining(sx * z, CAMERA_HEIGHT + sy * z, z, flat < wall);
        let open = self.opening(sx, sy);
        if open == 0.0 { inside } else { blend(inside, self.outside(u, v, sx * z, z), open) }
    }

    /// Returns 1 well inside the exit, 0 well outside, smooth over some pixels.
    fn opening(&self, sx: f32, sy: f32) -> f32 {
        let (x, y) = (sx * self.exit, CAMERA_HEIGHT + sy * self.exit);
        let side = (x - WALLS[0]).min(WALLS[1] - x);
        let inner = side.min(CEILING - y);
        // The upper corners are rounded, as those of a bored tunnel.
        let corner = 1.3 - side.min(1.3);
        let rounded = inner.min(CEILING - y - 0.55 * corner * corner);
        let soft = 6.0 * self.view.scale() * self.exit / self.view.focal;
        ramp(-soft, soft, rounded)
    }

    /// Returns the radiance beyond the exit: bright sky, hazy hills, trees.
    fn outside(&self, u: f32, v: f32, x: f32, z: f32) -> Rgb {
        let s = self.view.scale();
        let above = (self.view.cy - v) / s;
        let hills =
            5.0 + 12.0 * noise(u / s / 30.0, 1.0, self.seed) + 4.0 * noise(u / s / 7.0, 2.0, self.seed);
        let sky = self.light.sky(u, v, self.view);
        let cloud = 0.05 * noise(u / s / 20.0, above / 9.0, self.seed ^ 7);
        let bank = [0.33, 0.37, 0.33];
        let leaf = 0.08 * noise(u / s / 5.0, v / s / 5.0, self.seed ^ 9);
        let far = blend(add(sky, [cloud; 3]), add(bank, [leaf; 3]), ramp(-2.5, 2.5, hills - above));
        if above > 0.0 { far } else { blend(far, self.floor(x, z), 0.5) }
    }

    fn floor(&self, x: f32, z: f32) -> Rgb {
        let pixel = z / self.view.focal;
        let albedo = road(
            x,
            z + self.driven,
            z * pixel / CAMERA_HEIGHT,
            pixel,
            [WALLS[0] - 0.3, WALLS[1] + 1.4],
            self.seed,
        );
        let beyond = ramp(-9.0, 12.0, z - self.exit);
        let bright = add(self.light.shade(albedo, [0.0, 1.0, 0.0], self.exit.max(z)), [0.20, 0.21, 0.21]);
        blend(self.light.shade(albedo, [0.0, 1.0, 0.0], z.min(self.exit)), bright, beyond)
    }

    /// Returns the radiance of wall or ceiling: slabs with joints, a painted band, lamps overhead.
    fn lining(&self, x: f32, y: f32, z: f32, overhead: bool) -> Rgb {
        // The lining ends at the exit.
        let z = z.min(self.exit);
        let along = (z + self.driven) / 4.0;
        let soft = (0.25 * z * z / (self.view.focal * 6.0)).clamp(0.015, 0.5);
        let t = along - along.floor();
        let joint = ramp(-soft, soft, 0.02 + soft * 0.3 - t.min(1.0 - t)) * (1.0 - ramp(0.1, 0.5, soft));
        let slab = 0.85 + 0.3 * unit(hash(along.floor() as i32 as u32, 0, self.seed));
        let stain = 0.75 + 0.5 * noise(along * 4.0, if overhead { x } else { y }, self.seed);
        let band = if overhead { 0.0 } else { ramp(-0.1, 0.1, 1.0 - (y - 0.6).abs() * 2.0) };
        let base = mix(0.30, 0.52, band) * mix(slab, 1.0, ramp(0.1, 0.5, soft)) * stain * (1.0 - 0.5 * joint);
        let normal = if overhead { [0.0, -1.0, 0.0] } else { [-x.signum(), 0.0, 0.0] };
        let lit = self.light.shade([base, base * 0.97, base * 0.88], normal, z);
        if overhead { add(lit, self.lamps(x, along, soft)) } else { lit }
    }

    /// Returns the radiance of the strip lamps along the ceiling.
    fn lamps(&self, x: f32, along: f32, soft: f32) -> Rgb {
        let t = along / 2.0 - (along / 2.0).floor();
        let on = mix(ramp(0.0, 0.22, 0.36 - (t - 0.5).abs()), 0.7, ramp(0.05, 0.3, soft));
        let near = ((x + 2.0).abs()).min((x - 1.8).abs());
        scaled([0.17, 0.13, 0.07], on * (1.0 - ramp(0.10, 0.75, near)))
    }
}

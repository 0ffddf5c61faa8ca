//! What the camera would see if it were perfect: for every pixel the first surface on its ray.
//!
//! Bodies are drawn one after the other into a buffer of depths, each over the pixels of its window only; the ground
//! comes last, since most of its rays have ended by then.

use nalgebra::Vector3;

use super::camera::{Camera, N_COLUMNS, N_PIXELS, View, Window};
use super::ground::Ground;
use super::material::Material;
use super::solid::{Body, Solid, Target};

/// The first surface on the ray of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surface {
    /// Distance along the optical axis, metres.
    pub(super) depth_m: f64,
    /// Cosine of the angle between the ray and the surface's normal.
    pub(super) incidence: f64,
    /// Outward normal in the world, of length 1.
    pub(super) normal: Vector3<f64>,
    pub(super) material: Material,
}

/// Surfaces of all pixels, of one frame at a time.
pub(super) struct Picture {
    camera: Camera,
    range_m_max: f64,
    /// `(N_PIXELS,)`: the surface, or one at `range_m_max` where there is none before it.
    surfaces: Vec<Surface>,
    /// Bodies are drawn over the whole image, near and far: slow, and the same.
    #[cfg(test)]
    pub(super) culls: bool,
}

impl Picture {
    /// A picture in which nothing farther than `range_m_max` along a ray appears.
    pub(super) fn new(camera: Camera, range_m_max: f64) -> Self {
        let none =
            Surface { depth_m: 0.0, incidence: 1.0, normal: Vector3::zeros(), material: Material::Asphalt };
        Self {
            camera,
            range_m_max,
            surfaces: vec![none; N_PIXELS],
            #[cfg(test)]
            culls: true,
        }
    }

    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The surfaces of all pixels, row by row; `None` where there is none within range. `(N_PIXELS,)`.
    pub(super) fn surfaces(&self) -> impl Iterator<Item = Option<&Surface>> {
        self.surfaces.iter().zip(self.camera.range_per_depth()).map(|(surface, range_per_depth)| {
            (surface.depth_m < self.range_m_max / range_per_depth).then_some(surface)
        })
    }

    /// Draws `solids` and `ground` as `view` sees them.
    pub(super) fn draw<'a>(&mut self, view: &View, solids: impl Iterator<Item = &'a Solid>, ground: &Ground) {
        for (surface, range_per_depth) in self.surfaces.iter_mut().zip(self.camera.range_per_depth()) {
            surface.depth_m = self.range_m_max / range_per_depth;
        }
        for solid in solids {
            if let Some(window) = self.window(view, &solid.body) {
                match &solid.body {
                    Body::Block(block) => {
                        self.draw_target(view, &window, &block.seen_from(&view.eye), solid.material);
                    }
                    Body::Column(column) => {
                        self.draw_target(view, &window, &column.seen_from(&view.eye), solid.material);
                    }
                    Body::Ellipsoid(ellipsoid) => {
                        self.draw_target(view, &window, &ellipsoid.seen_from(&view.eye), solid.material);
                    }
                }
            }
        }
        self.draw_ground(view, ground);
    }

    fn window(&self, view: &View, body: &Body) -> Option<Window> {
        #[cfg(test)]
        if !self.culls {
            return Some(Window::whole());
        }
        if body.is_beyond(&view.eye, self.range_m_max) {
            return None;
        }
        self.camera.window(view, &body.corners())
    }

    fn draw_target(&mut self, view: &View, window: &Window, target: &impl Target, material: Material) {
        for row in window.rows.clone() {
            let start = row * N_COLUMNS;
            let surfaces = &mut self.surfaces[start + window.columns.start..start + window.columns.end];
            for (ray, surface) in self.camera.rays(view, row, window.columns.clone()).zip(surfaces) {
                let depth_m = target.depth(&ray);
                if depth_m < surface.depth_m {
                    let normal = target.normal(&(ray * depth_m));
                    *surface = Surface { depth_m, incidence: incidence(&normal, &ray), normal, material };
                }
            }
        }
    }

    fn draw_ground(&mut self, view: &View, ground: &Ground) {
        for (row, surfaces) in self.surfaces.chunks_exact_mut(N_COLUMNS).enumerate() {
            for (ray, surface) in self.camera.rays(view, row, 0..N_COLUMNS).zip(surfaces) {
                let depth_m = ground.depth(&view.eye, &ray, surface.depth_m);
                if depth_m < surface.depth_m {
                    let hit = view.eye + ray * depth_m;
                    let normal = ground.normal(hit.x, hit.y);
                    let material = ground.cover(hit.x, hit.y);
                    *surface = Surface { depth_m, incidence: incidence(&normal, &ray), normal, material };
                }
            }
        }
    }
}

/// Cosine of the angle at which a ray meets a surface; 0 where rounding lets it come from behind.
fn incidence(normal: &Vector3<f64>, ray: &Vector3<f64>) -> f64 {
    (-normal.dot(ray) / ray.norm()).max(0.0)
}

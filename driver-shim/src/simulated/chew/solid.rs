//! Things that stand on the ground, made of three convex bodies: blocks, columns and ellipsoids.

use nalgebra::Vector3;

use super::camera::NEAREST_DEPTH_M;
use super::material::Material;

/// A body and what it is made of.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Solid {
    pub(super) body: Body,
    pub(super) material: Material,
}

/// A convex body, upright.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Body {
    Block(Block),
    Column(Column),
    Ellipsoid(Ellipsoid),
}

/// A box with vertical sides, turned about the vertical.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    pub(super) centre: Vector3<f64>,
    /// Half its length, width and height, metres.
    pub(super) half: Vector3<f64>,
    /// Cosine and sine of its heading.
    pub(super) heading: (f64, f64),
}

/// A vertical cylinder without lids: it is taller than the camera stands, or something lies on it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) centre: Vector3<f64>,
    pub(super) radius_m: f64,
    pub(super) half_height_m: f64,
}

/// An ellipsoid with vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ellipsoid {
    pub(super) centre: Vector3<f64>,
    pub(super) radius_m: f64,
    pub(super) half_height_m: f64,
}

/// A body as the camera's rays meet it.
pub(super) trait Target {
    /// Ray parameter of the first surface met from outside, infinite if none is.
    fn depth(&self, ray: &Vector3<f64>) -> f64;
    /// Outward normal, of length 1, at the point `hit` relative to the eye.
    fn normal(&self, hit: &Vector3<f64>) -> Vector3<f64>;
}

impl Solid {
    /// A block on a floor at `z_m`, `size` long, wide and high.
    pub(super) fn block(
        material: Material,
        (x_m, y_m): (f64, f64),
        z_m: f64,
        size: [f64; 3],
        yaw_rad: f64,
    ) -> Self {
        let half = Vector3::from(size) / 2.0;
        let (sin, cos) = libm::sincos(yaw_rad);
        let centre = Vector3::new(x_m, y_m, z_m + half.z);
        Self { body: Body::Block(Block { centre, half, heading: (cos, sin) }), material }
    }

    /// A column on a floor at `z_m`.
    pub(super) fn column(
        material: Material,
        (x_m, y_m): (f64, f64),
        z_m: f64,
        radius_m: f64,
        height_m: f64,
    ) -> Self {
        let half_height_m = height_m / 2.0;
        let centre = Vector3::new(x_m, y_m, z_m + half_height_m);
        Self { body: Body::Column(Column { centre, radius_m, half_height_m }), material }
    }

    /// An ellipsoid whose lowest point is at `z_m`.
    pub(super) fn ellipsoid(
        material: Material,
        (x_m, y_m): (f64, f64),
        z_m: f64,
        radius_m: f64,
        height_m: f64,
    ) -> Self {
        let half_height_m = height_m / 2.0;
        let centre = Vector3::new(x_m, y_m, z_m + half_height_m);
        Self { body: Body::Ellipsoid(Ellipsoid { centre, radius_m, half_height_m }), material }
    }
}

impl Body {
    /// Corners of a box around the body, in the order that [`Camera::window`](super::camera::Camera::window) wants.
    pub(super) fn corners(&self) -> [Vector3<f64>; 8] {
        let (centre, half, (cos, sin)) = match self {
            Self::Block(block) => (block.centre, block.half, block.heading),
            Self::Column(Column { centre, radius_m, half_height_m })
            | Self::Ellipsoid(Ellipsoid { centre, radius_m, half_height_m }) => {
                (*centre, Vector3::new(*radius_m, *radius_m, *half_height_m), (1.0, 0.0))
            }
        };
        std::array::from_fn(|corner| {
            let side = |bit: usize, half: f64| if corner & bit == 0 { -half } else { half };
            let (along, across) = (side(1, half.x), side(2, half.y));
            centre + Vector3::new(cos * along - sin * across, sin * along + cos * across, side(4, half.z))
        })
    }

    /// Whether all of the body is farther than `range_m` from `eye`. May say no where it is.
    pub(super) fn is_beyond(&self, eye: &Vector3<f64>, range_m: f64) -> bool {
        let (centre, radius_m) = match self {
            Self::Block(block) => (&block.centre, block.half.norm()),
            Self::Column(column) => (&column.centre, column.radius_m + column.half_height_m),
            Self::Ellipsoid(ellipsoid) => {
                (&ellipsoid.centre, ellipsoid.radius_m.max(ellipsoid.half_height_m))
            }
        };
        (centre - eye).norm() > range_m + radius_m
    }
}

/// [`Block`] in a frame that is turned with it and has its origin in the eye.
pub(super) struct SeenBlock {
    centre: Vector3<f64>,
    half: Vector3<f64>,
    heading: (f64, f64),
}

impl Block {
    pub(super) fn seen_from(&self, eye: &Vector3<f64>) -> SeenBlock {
        let centre = turn_into(self.heading, &(self.centre - eye));
        SeenBlock { centre, half: self.half, heading: self.heading }
    }
}

impl Target for SeenBlock {
    /// Enters where the last of the three slabs is entered.
    #[inline]
    fn depth(&self, ray: &Vector3<f64>) -> f64 {
        let ray = turn_into(self.heading, ray);
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / ray[axis];
            let a = (self.centre[axis] - self.half[axis]) * inverse;
            let b = (self.centre[axis] + self.half[axis]) * inverse;
            // A ray that runs within a side has 0 · ∞ = NaN here, which min and max leave out.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if enter <= leave && enter >= NEAREST_DEPTH_M { enter } else { f64::INFINITY }
    }

    /// Of the side to which the hit is nearest, by share of the block's size.
    fn normal(&self, hit: &Vector3<f64>) -> Vector3<f64> {
        let place = (turn_into(self.heading, hit) - self.centre).component_div(&self.half);
        let axis = place.iamax();
        let mut normal = Vector3::zeros();
        normal[axis] = 1.0_f64.copysign(place[axis]);
        let (cos, sin) = self.heading;
        Vector3::new(cos * normal.x - sin * normal.y, sin * normal.x + cos * normal.y, normal.z)
    }
}

/// [`Column`] seen from the eye.
pub(super) struct SeenColumn {
    centre: Vector3<f64>,
    radius_m: f64,
    half_height_m: f64,
}

impl Column {
    pub(super) fn seen_from(&self, eye: &Vector3<f64>) -> SeenColumn {
        let Self { centre, radius_m, half_height_m } = *self;
        SeenColumn { centre: centre - eye, radius_m, half_height_m }
    }
}

impl Target for SeenColumn {
    #[inline]
    fn depth(&self, ray: &Vector3<f64>) -> f64 {
        let squared = ray.x * ray.x + ray.y * ray.y;
        let half_linear = ray.x * self.centre.x + ray.y * self.centre.y;
        let constant =
            self.centre.x * self.centre.x + self.centre.y * self.centre.y - self.radius_m * self.radius_m;
        let depth = first_root(squared, half_linear, constant);
        if (ray.z * depth - self.centre.z).abs() <= self.half_height_m { depth } else { f64::INFINITY }
    }

    fn normal(&self, hit: &Vector3<f64>) -> Vector3<f64> {
        let outward = (hit - self.centre) / self.radius_m;
        Vector3::new(outward.x, outward.y, 0.0)
    }
}

/// [`Ellipsoid`] seen from the eye, its vertical axis scaled until it is a sphere.
pub(super) struct SeenEllipsoid {
    centre: Vector3<f64>,
    radius_m: f64,
    z_scale: f64,
}

impl Ellipsoid {
    pub(super) fn seen_from(&self, eye: &Vector3<f64>) -> SeenEllipsoid {
        let z_scale = self.radius_m / self.half_height_m;
        let centre = (self.centre - eye).component_mul(&Vector3::new(1.0, 1.0, z_scale));
        SeenEllipsoid { centre, radius_m: self.radius_m, z_scale }
    }
}

impl Target for SeenEllipsoid {
    #[inline]
    fn depth(&self, ray: &Vector3<f64>) -> f64 {
        let ray = Vector3::new(ray.x, ray.y, ray.z * self.z_scale);
        let constant = self.centre.norm_squared() - self.radius_m * self.radius_m;
        first_root(ray.norm_squared(), ray.dot(&self.centre), constant)
    }

    fn normal(&self, hit: &Vector3<f64>) -> Vector3<f64> {
        let sphere = Vector3::new(hit.x, hit.y, hit.z * self.z_scale) - self.centre;
        // A gradient's component scales with the inverse of a length: once for the point, once for the axis.
        Vector3::new(sphere.x, sphere.y, sphere.z * self.z_scale).normalize()
    }
}

/// A vector of the world in a frame turned by `heading` about the vertical.
#[inline]
fn turn_into((cos, sin): (f64, f64), v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
}

/// The lesser root of `squared t² − 2 half_linear t + constant = 0`, if the camera sees that far near; else infinite.
#[inline]
fn first_root(squared: f64, half_linear: f64, constant: f64) -> f64 {
    let discriminant = half_linear * half_linear - squared * constant;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    let root = (half_linear - discriminant.sqrt()) / squared;
    if root >= NEAREST_DEPTH_M { root } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYE: Vector3<f64> = Vector3::new(1.0, 2.0, 0.6);

    fn check<T: Target>(target: &T, ray: [f64; 3], expected_m: f64, normal: [f64; 3]) {
        let ray = Vector3::from(ray);
        let depth_m = target.depth(&ray);
        assert!((depth_m - expected_m).abs() < 1e-12, "{depth_m}, not {expected_m}");
        assert!((target.normal(&(ray * depth_m)) - Vector3::from(normal)).norm() < 1e-9);
    }

    #[test]
    fn bodies_are_met_where_they_begin() {
        let block =
            Block { centre: EYE + Vector3::x() * 4.0, half: Vector3::repeat(1.0), heading: (1.0, 0.0) };
        check(&block.seen_from(&EYE), [1.0, 0.0, 0.0], 3.0, [-1.0, 0.0, 0.0]);
        let (sin, cos) = libm::sincos(std::f64::consts::FRAC_PI_4);
        let turned = Block { heading: (cos, sin), half: Vector3::new(1.0, 2.0, 1.0), ..block };
        check(&turned.seen_from(&EYE), [1.0, 0.0, 0.0], 4.0 - 2.0_f64.sqrt(), [-cos, -sin, 0.0]);
        let column = Column { centre: EYE + Vector3::x() * 4.0, radius_m: 0.5, half_height_m: 1.0 };
        check(&column.seen_from(&EYE), [1.0, 0.0, 0.0], 3.5, [-1.0, 0.0, 0.0]);
        let ellipsoid = Ellipsoid { centre: EYE + Vector3::z() * 4.0, radius_m: 2.0, half_height_m: 1.0 };
        check(&ellipsoid.seen_from(&EYE), [0.0, 0.0, 1.0], 3.0, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn nothing_behind_the_eye_or_around_it_is_met() {
        for x in [-4.0, 0.0] {
            let centre = EYE + Vector3::x() * x;
            let block = Block { centre, half: Vector3::repeat(1.0), heading: (1.0, 0.0) };
            let column = Column { centre, radius_m: 1.0, half_height_m: 1.0 };
            let ellipsoid = Ellipsoid { centre, radius_m: 1.0, half_height_m: 1.0 };
            let ray = Vector3::new(1.0, 0.1, -0.1);
            assert_eq!(block.seen_from(&EYE).depth(&ray), f64::INFINITY);
            assert_eq!(column.seen_from(&EYE).depth(&ray), f64::INFINITY);
            assert_eq!(ellipsoid.seen_from(&EYE).depth(&ray), f64::INFINITY);
        }
    }

    #[test]
    fn the_normal_of_an_ellipsoid_is_across_its_surface() {
        let ellipsoid = Ellipsoid { centre: EYE + Vector3::x() * 6.0, radius_m: 2.0, half_height_m: 1.0 };
        let seen = ellipsoid.seen_from(&EYE);
        let at = |y: f64, z: f64| {
            let ray = Vector3::new(1.0, y, z);
            ray * seen.depth(&ray)
        };
        let (hit, beside, above) = (at(0.1, 0.1), at(0.1 + 1e-6, 0.1), at(0.1, 0.1 + 1e-6));
        let across = (beside - hit).cross(&(above - hit)).normalize();
        assert!((across.dot(&seen.normal(&hit)).abs() - 1.0).abs() < 1e-6);
    }
}

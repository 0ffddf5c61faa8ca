//! What surfaces do with the camera's own light (near infrared, 850 nm) and with the sun's.

/// What a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Material {
    Grass,
    Asphalt,
    Paving,
    Brick,
    Render,
    Glass,
    Wood,
    Bark,
    Foliage,
    Awning,
    DarkCloth,
    LightCloth,
    DarkPaint,
    LightPaint,
    Tyre,
}

/// How a material returns light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Optics {
    /// Share of the light that comes back from a surface met squarely.
    pub(super) reflectance: f64,
    /// 0 for a smooth matt surface, which darkens with the cosine of incidence; 1 for one that looks the same from
    /// everywhere, as blades and leaves nearly do.
    pub(super) roughness: f64,
    /// How far light enters before it returns, at most, metres: between leaves and blades.
    pub(super) depth_m: f64,
}

impl Material {
    /// Rough values for 850 nm, at which everything that grows is bright.
    pub(super) fn optics(self) -> Optics {
        let (reflectance, roughness, depth_m) = match self {
            Self::Grass => (0.50, 0.40, 0.04),
            Self::Asphalt => (0.16, 0.20, 0.00),
            Self::Paving => (0.38, 0.15, 0.00),
            Self::Brick => (0.45, 0.10, 0.00),
            Self::Render => (0.75, 0.05, 0.00),
            // Most light goes through or elsewhere.
            Self::Glass => (0.05, 0.00, 0.00),
            Self::Wood => (0.50, 0.10, 0.00),
            Self::Bark => (0.35, 0.20, 0.01),
            Self::Foliage => (0.55, 0.60, 0.50),
            Self::Awning => (0.60, 0.20, 0.00),
            Self::DarkCloth => (0.20, 0.20, 0.01),
            Self::LightCloth => (0.65, 0.20, 0.01),
            Self::DarkPaint => (0.08, 0.05, 0.00),
            Self::LightPaint => (0.60, 0.05, 0.00),
            Self::Tyre => (0.06, 0.20, 0.00),
        };
        Optics { reflectance, roughness, depth_m }
    }
}

//! Which unknown of a rigid body lies where in z = (ω, θ): what moves it comes first.
//!
//! | unknowns | place | count |
//! |---|---|---|
//! | ω | 0 | 3 |
//! | j: J = I + Σ j_k E_k | [`INERTIA`] | 5 |
//! | β: b = b0 + N0 β | [`TILT`] | 2 |
//! | S: entries 11, 12, 22 | [`DRAG`] | 3 |
//! | γ of the drag | [`DRAG_CUBIC`] | 1 |
//! | G by rows | [`GAIN`] | 2 p |
//! | r | [`offset`] | p |
//! | γ of the output | [`output_cubic`] | 1 |

/// Of j.
pub const INERTIA: usize = 3;
/// Of β.
pub const TILT: usize = 8;
/// Of S.
pub const DRAG: usize = 10;
/// Of the drag's γ.
pub const DRAG_CUBIC: usize = 13;
/// Of G.
pub const GAIN: usize = 14;

/// Of r.
pub const fn offset(p: usize) -> usize {
    GAIN + 2 * p
}

/// Of the output's γ.
pub const fn output_cubic(p: usize) -> usize {
    GAIN + 3 * p
}

/// How many outputs p there are, of P that there is room for: the others have infinite noise.
pub fn outputs<const P: usize>(noise: &[f64; P]) -> usize {
    noise.iter().filter(|sd| sd.is_finite()).count()
}

/// How many unknowns there are with p outputs.
pub const fn unknowns(p: usize) -> usize {
    GAIN + 3 * p + 1
}

//! What the examples share: noise for what they simulate, and what a program of the target needs.

/// A generator of noise, small rather than good.
pub struct Noise(pub u32);

impl Noise {
    /// About normal, of deviation 1: twelve uniform numbers less their mean.
    pub fn normal(&mut self) -> f32 {
        let sum: f32 = (0..12).map(|_| self.uniform()).sum();
        sum - 6.0
    }

    fn uniform(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 24) as f32
    }
}

/// Where firmware would say what happened and reset.
#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

//! Vectors of floats of one instruction set behind one trait, so that a kernel is written once.

/// A register of `N` floats.
///
/// # Safety
/// Every function may be called only where the instruction set of the type is available; `load` and
/// `store` need `N` floats behind the pointer.
pub(super) trait Lanes {
    /// Floats in a register.
    const N: usize;
    /// A register.
    type V: Copy;

    unsafe fn splat(value: f32) -> Self::V;
    unsafe fn load(from: *const f32) -> Self::V;
    unsafe fn store(to: *mut f32, value: Self::V);
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V;
    /// `a * b + c`.
    unsafe fn mul_add(a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `z` where it is at least 0, else `slope * z`.
    unsafe fn leak(z: Self::V, slope: Self::V) -> Self::V;
    /// Four floats again and again.
    unsafe fn load_quad(from: *const f32) -> Self::V;
    /// In each group of four floats, the one of this number four times.
    unsafe fn spread<const LANE: usize>(value: Self::V) -> Self::V;
}

/// Plain arrays, which the compiler puts into whatever registers there are.
pub(super) struct Portable<const N: usize>;

impl<const N: usize> Lanes for Portable<N> {
    const N: usize = N;
    type V = [f32; N];

    #[inline(always)]
    unsafe fn splat(value: f32) -> [f32; N] {
        [value; N]
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> [f32; N] {
        // SAFETY: the caller has N floats there; an array of floats needs no alignment beyond theirs.
        unsafe { from.cast::<[f32; N]>().read() }
    }

    #[inline(always)]
    unsafe fn store(to: *mut f32, value: [f32; N]) {
        // SAFETY: the caller has room for N floats there.
        unsafe { to.cast::<[f32; N]>().write(value) }
    }

    #[inline(always)]
    unsafe fn add(a: [f32; N], b: [f32; N]) -> [f32; N] {
        std::array::from_fn(|lane| a[lane] + b[lane])
    }

    #[inline(always)]
    unsafe fn mul_add(a: [f32; N], b: [f32; N], c: [f32; N]) -> [f32; N] {
        // A fused operation is a library call where the processor lacks it.
        if cfg!(any(target_arch = "aarch64", target_feature = "fma")) {
            std::array::from_fn(|lane| a[lane].mul_add(b[lane], c[lane]))
        } else {
            std::array::from_fn(|lane| a[lane] * b[lane] + c[lane])
        }
    }

    #[inline(always)]
    unsafe fn leak(z: [f32; N], slope: [f32; N]) -> [f32; N] {
        std::array::from_fn(|lane| {
            if z[lane] >= 0.0 {
                z[lane]
            } else {
                slope[lane] * z[lane]
            }
        })
    }

    #[inline(always)]
    unsafe fn load_quad(from: *const f32) -> [f32; N] {
        // SAFETY: the caller has four floats there.
        std::array::from_fn(|lane| unsafe { *from.add(lane % 4) })
    }

    #[inline(always)]
    unsafe fn spread<const LANE: usize>(value: [f32; N]) -> [f32; N] {
        std::array::from_fn(|lane| value[lane / 4 * 4 + LANE])
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx, Avx512, Sse};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Lanes;
    use std::arch::x86_64::{
        __m128, __m256, __m512, _CMP_GE_OQ, _mm_add_ps, _mm_blendv_ps, _mm_cmpge_ps, _mm_fmadd_ps,
        _mm_loadu_ps, _mm_mul_ps, _mm_permute_ps, _mm_set1_ps, _mm_setzero_ps, _mm_storeu_ps,
        _mm256_add_ps, _mm256_blendv_ps, _mm256_cmp_ps, _mm256_fmadd_ps, _mm256_loadu_ps,
        _mm256_mul_ps, _mm256_permute_ps, _mm256_set_m128, _mm256_set1_ps, _mm256_setzero_ps,
        _mm256_storeu_ps, _mm512_add_ps, _mm512_broadcast_f32x4, _mm512_cmp_ps_mask,
        _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_mask_mov_ps, _mm512_mul_ps, _mm512_permute_ps,
        _mm512_set1_ps, _mm512_setzero_ps, _mm512_storeu_ps,
    };

    /// Four floats with fused multiply-add, for the few layers of four channels.
    pub(in super::super) struct Sse;
    /// Eight floats.
    pub(in super::super) struct Avx;
    /// Sixteen floats.
    pub(in super::super) struct Avx512;

    macro_rules! lanes {
        ($name:ident, $n:literal, $v:ty, $set1:ident, $load:ident, $store:ident, $add:ident,
         $fmadd:ident, $leak:expr, $quad:expr, $permute:ident) => {
            impl Lanes for $name {
                const N: usize = $n;
                type V = $v;

                #[inline(always)]
                unsafe fn splat(value: f32) -> $v {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe { $set1(value) }
                }

                #[inline(always)]
                unsafe fn load(from: *const f32) -> $v {
                    // SAFETY: the caller vouches for the instruction set and the floats.
                    unsafe { $load(from) }
                }

                #[inline(always)]
                unsafe fn store(to: *mut f32, value: $v) {
                    // SAFETY: the caller vouches for the instruction set and the room.
                    unsafe { $store(to, value) }
                }

                #[inline(always)]
                unsafe fn add(a: $v, b: $v) -> $v {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe { $add(a, b) }
                }

                #[inline(always)]
                unsafe fn mul_add(a: $v, b: $v, c: $v) -> $v {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe { $fmadd(a, b, c) }
                }

                #[inline(always)]
                unsafe fn leak(z: $v, slope: $v) -> $v {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe { $leak(z, slope) }
                }

                #[inline(always)]
                unsafe fn load_quad(from: *const f32) -> $v {
                    // SAFETY: the caller vouches for the instruction set and the floats.
                    unsafe { $quad(_mm_loadu_ps(from)) }
                }

                #[inline(always)]
                unsafe fn spread<const LANE: usize>(value: $v) -> $v {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe {
                        match LANE {
                            0 => $permute::<0b00_00_00_00>(value),
                            1 => $permute::<0b01_01_01_01>(value),
                            2 => $permute::<0b10_10_10_10>(value),
                            _ => $permute::<0b11_11_11_11>(value),
                        }
                    }
                }
            }
        };
    }

    lanes!(
        Sse,
        4,
        __m128,
        _mm_set1_ps,
        _mm_loadu_ps,
        _mm_storeu_ps,
        _mm_add_ps,
        _mm_fmadd_ps,
        |z, slope| _mm_blendv_ps(_mm_mul_ps(z, slope), z, _mm_cmpge_ps(z, _mm_setzero_ps())),
        |quad| quad,
        _mm_permute_ps
    );
    lanes!(
        Avx,
        8,
        __m256,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_fmadd_ps,
        |z, slope| _mm256_blendv_ps(
            _mm256_mul_ps(z, slope),
            z,
            _mm256_cmp_ps::<_CMP_GE_OQ>(z, _mm256_setzero_ps())
        ),
        |quad| _mm256_set_m128(quad, quad),
        _mm256_permute_ps
    );
    lanes!(
        Avx512,
        16,
        __m512,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_add_ps,
        _mm512_fmadd_ps,
        |z, slope| _mm512_mask_mov_ps(
            _mm512_mul_ps(z, slope),
            _mm512_cmp_ps_mask::<_CMP_GE_OQ>(z, _mm512_setzero_ps()),
            z
        ),
        _mm512_broadcast_f32x4,
        _mm512_permute_ps
    );
}

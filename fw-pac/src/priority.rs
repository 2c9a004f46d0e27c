//! Ownership by interrupt priority, checked by the compiler.
//!
//! A handler gets the token of its priority from `interrupts::handlers!`, and only that token opens what
//! belongs to the priority. Handlers of one priority never preempt each other, so there is one borrow at
//! a time. Boot, which runs with interrupts masked, holds the robot's token until it enables them.

use core::cell::UnsafeCell;
use core::marker::PhantomData;
use core::mem::MaybeUninit;
use cortex_m::interrupt::CriticalSection;
use cortex_m::register::basepri;

/// Proof of running at NVIC priority `LEVEL`, the lower the more urgent. Zero-sized, not to be copied
/// and not to be sent to another priority.
pub struct Priority<const LEVEL: u8>(PhantomData<*mut ()>);

/// Timestamps of ticks and echoes: preempted by nothing but the safe state.
pub type Capture = Priority<0>;
/// The end of an SPI frame.
pub type FrameEnd = Priority<1>;
/// Everything that touches the robot's state.
pub type RobotLevel = Priority<2>;

impl<const LEVEL: u8> Priority<LEVEL> {
    /// The number in the NVIC's registers: four bits are implemented, at the top.
    pub const NVIC: u8 = LEVEL << 4;

    /// # Safety
    /// Within a handler of this priority, once; or in boot with interrupts masked, once.
    pub const unsafe fn new() -> Self {
        Self(PhantomData)
    }
}

impl Capture {
    /// The highest priority is as good as masked.
    #[inline]
    #[allow(clippy::unused_self, reason = "the token is the proof")]
    pub fn critical_section(&self) -> CriticalSection {
        // SAFETY: only what ends in the safe state preempts it.
        unsafe { CriticalSection::new() }
    }
}

impl FrameEnd {
    /// Runs `f` at this priority: only captures preempt it.
    ///
    /// # Safety
    /// At the robot's priority or in boot, and not within another call.
    #[inline]
    pub unsafe fn raised<R>(f: impl FnOnce(&mut Self) -> R) -> R {
        // SAFETY: no handler of this priority runs until the end, so the token is the only one.
        unsafe {
            basepri::write(Self::NVIC);
            let result = f(&mut Self::new());
            basepri::write(0);
            result
        }
    }
}

/// A static that priority `LEVEL` owns.
pub struct Owned<const LEVEL: u8, T>(UnsafeCell<T>);

// SAFETY: `borrow` is the only access and needs the token, of which one exists at a time.
unsafe impl<const LEVEL: u8, T> Sync for Owned<LEVEL, T> {}

impl<const LEVEL: u8, T> Owned<LEVEL, T> {
    /// The static's first value.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// The value, for as long as the token is borrowed.
    #[inline]
    pub fn borrow<'a>(&'static self, _: &'a mut Priority<LEVEL>) -> &'a mut T {
        // SAFETY: the token is borrowed exclusively for 'a, and a static has one address.
        unsafe { &mut *self.0.get() }
    }
}

/// A value that boot constructs in place; all zeros until then, so that it needs no flash.
pub struct Slot<T> {
    value: MaybeUninit<T>,
    present: bool,
}

impl<T> Slot<T> {
    /// Without a value.
    pub const EMPTY: Self = Self {
        value: MaybeUninit::uninit(),
        present: false,
    };

    /// Stores a value, without dropping an earlier one.
    #[inline]
    pub fn insert(&mut self, value: T) -> &mut T {
        self.present = true;
        self.value.write(value)
    }

    /// The slot's memory, zeroed, for another use before the value is there.
    ///
    /// # Safety
    /// Zeros must be a valid `U`, and no value may have been inserted.
    pub unsafe fn scratch<U>(&mut self) -> &mut U {
        const { assert!(size_of::<U>() <= size_of::<T>() && align_of::<U>() <= align_of::<T>()) };
        let memory: *mut U = self.value.as_mut_ptr().cast();
        // SAFETY: large enough, aligned, and zeros are a value (the caller's promise).
        unsafe {
            memory.write_bytes(0, 1);
            &mut *memory
        }
    }

    /// The value, once there is one.
    #[inline]
    pub fn get(&mut self) -> Option<&mut T> {
        // SAFETY: `present` follows the first `insert`.
        self.present
            .then(|| unsafe { self.value.assume_init_mut() })
    }
}

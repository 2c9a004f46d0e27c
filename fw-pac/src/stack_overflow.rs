//! A stack overflow on purpose.

/// Uses up the stack.
#[allow(unconditional_recursion)]
pub fn descend(depth: u32) -> u32 {
    let frame = [depth; 64];
    // A bound that the compiler cannot see: endless recursion it may remove.
    if core::hint::black_box(&frame)[0] == u32::MAX {
        return 0;
    }
    descend(depth + 1) + core::hint::black_box(&frame).iter().sum::<u32>()
}

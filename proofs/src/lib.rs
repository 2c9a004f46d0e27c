//! The theorems, each a property with its Kani harness and its test.

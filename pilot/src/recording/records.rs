//! The frame of MCAP's records: where a recording stops to be whole.

/// A record that holds others.
const CHUNK: u8 = 0x06;
/// Bytes of a chunk before the length of its compression's name.
const CHUNK_HEAD: usize = 28;
const MAGIC_LEN: usize = 8;

/// A recording's bytes up to the first record that is cut off or states a length beyond its end. The `mcap`
/// crate adds such lengths without a check.
pub fn whole(bytes: &[u8]) -> &[u8] {
    let mut at = MAGIC_LEN;
    while let Some((opcode, content)) = record(bytes, at) {
        if opcode == CHUNK && !is_whole_chunk(content) {
            break;
        }
        at += 9 + content.len();
    }
    bytes.get(..at).unwrap_or(bytes)
}

/// Opcode and content of the record that begins at `at`.
fn record(bytes: &[u8], at: usize) -> Option<(u8, &[u8])> {
    let (head, rest) = bytes.get(at..)?.split_first_chunk::<9>()?;
    let [opcode, len @ ..] = *head;
    let len = usize::try_from(u64::from_le_bytes(len)).ok()?;
    Some((opcode, rest.get(..len)?))
}

/// Whether the records of a chunk fill it and hold no chunk.
fn is_whole_chunk(content: &[u8]) -> bool {
    let records = || {
        let (name_len, rest) = content.get(CHUNK_HEAD..)?.split_first_chunk::<4>()?;
        let rest = rest.get(usize::try_from(u32::from_le_bytes(*name_len)).ok()?..)?;
        let (len, records) = rest.split_first_chunk::<8>()?;
        (u64::from_le_bytes(*len) == u64::try_from(records.len()).ok()?).then_some(records)
    };
    records().is_some_and(|records| {
        let mut at = 0;
        while let Some((opcode, content)) = record(records, at) {
            if opcode == CHUNK {
                return false;
            }
            at += 9 + content.len();
        }
        at == records.len()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(opcode: u8, len: u64, content: &[u8]) -> Vec<u8> {
        [&[opcode], &len.to_le_bytes()[..], content].concat()
    }

    #[test]
    fn record_beyond_its_end_cuts_the_recording() {
        let good = [&[0; MAGIC_LEN][..], &framed(5, 3, b"abc")].concat();
        let chunk = |inner: &[u8]| {
            let len = inner.len() as u64;
            let content = [&[0; CHUNK_HEAD + 4][..], &len.to_le_bytes(), inner].concat();
            framed(CHUNK, content.len() as u64, &content)
        };
        let sound = [&good[..], &chunk(&framed(5, 1, b"x"))].concat();
        assert_eq!(whole(&sound), sound);
        for bad in [
            framed(5, u64::MAX, b"abc"),
            framed(5, 4, b"abc"),
            chunk(&framed(5, u64::MAX - 3, b"x")),
            chunk(&framed(5, 2, b"x")),
            chunk(&chunk(b"")),
        ] {
            assert_eq!(whole(&[&good[..], &bad].concat()), good);
        }
    }
}

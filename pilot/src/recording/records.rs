//! The frame of MCAP's records. The `mcap` crate allocates and adds the lengths that a file states without
//! a check, so they are checked before it sees them.

const HEADER: u8 = 0x01;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
/// Bytes of a chunk before the length of its compression's name.
const CHUNK_HEAD: usize = 28;
const MAGIC_LEN: usize = 8;

/// A recording's magic and the records that lead to its messages, those of chunks without compression
/// among them, up to the first record that is cut off or states a length beyond its end.
pub fn sound(bytes: &[u8]) -> Vec<u8> {
    let mut kept = bytes.get(..MAGIC_LEN).unwrap_or_default().to_vec();
    let mut rest = bytes.get(MAGIC_LEN..).unwrap_or_default();
    while let Some((opcode, content)) = record(&mut rest) {
        let sound = match opcode {
            CHUNK => chunk(content).and_then(|mut records| {
                while !records.is_empty() {
                    let (opcode, content) = record(&mut records)?;
                    keep(opcode, content, &mut kept)?;
                }
                Some(())
            }),
            _ => keep(opcode, content, &mut kept),
        };
        if sound.is_none() {
            break;
        }
    }
    kept
}

/// Whether every record is followed by another one, the last by the magic.
pub fn is_whole(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(MAGIC_LEN..).unwrap_or_default();
    while record(&mut rest).is_some() {}
    rest.len() == MAGIC_LEN && bytes.starts_with(rest)
}

/// Takes a record: opcode and content.
fn record<'a>(rest: &mut &'a [u8]) -> Option<(u8, &'a [u8])> {
    let (opcode, after) = rest.split_first()?;
    let (len, after) = after.split_first_chunk::<8>()?;
    let len = usize::try_from(u64::from_le_bytes(*len)).ok()?;
    let (content, after) = after.split_at_checked(len)?;
    *rest = after;
    Some((*opcode, content))
}

/// Appends a record that leads to messages; None for one whose fields go beyond its end.
fn keep(opcode: u8, content: &[u8], kept: &mut Vec<u8>) -> Option<()> {
    let mut fields = content;
    match opcode {
        HEADER => {
            field(&mut fields)?;
            field(&mut fields)?;
        }
        SCHEMA => {
            fields = fields.get(2..)?;
            for _name_encoding_data in 0..3 {
                field(&mut fields)?;
            }
        }
        CHANNEL => {
            fields = fields.get(4..)?;
            field(&mut fields)?;
            field(&mut fields)?;
            let mut metadata = field(&mut fields)?;
            while !metadata.is_empty() {
                field(&mut metadata)?;
            }
        }
        MESSAGE => {}
        _ => return Some(()),
    }
    kept.push(opcode);
    kept.extend(u64::try_from(content.len()).ok()?.to_le_bytes());
    kept.extend(content);
    Some(())
}

/// Takes a field that begins with its length.
fn field<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (len, after) = rest.split_first_chunk::<4>()?;
    let (field, after) = after.split_at_checked(usize::try_from(u32::from_le_bytes(*len)).ok()?)?;
    *rest = after;
    Some(field)
}

/// The records of a chunk without compression.
fn chunk(content: &[u8]) -> Option<&[u8]> {
    let mut rest = content.get(CHUNK_HEAD..)?;
    if !field(&mut rest)?.is_empty() {
        return None;
    }
    let (len, records) = rest.split_first_chunk::<8>()?;
    (u64::from_le_bytes(*len) == u64::try_from(records.len()).ok()?).then_some(records)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(opcode: u8, len: u64, content: &[u8]) -> Vec<u8> {
        [&[opcode], &len.to_le_bytes()[..], content].concat()
    }

    #[test]
    fn record_beyond_its_end_cuts_the_recording() {
        let good = [&[0; MAGIC_LEN][..], &framed(MESSAGE, 3, b"abc")].concat();
        let chunk = |inner: &[u8]| {
            let len = inner.len() as u64;
            let content = [&[0; CHUNK_HEAD + 4][..], &len.to_le_bytes(), inner].concat();
            framed(CHUNK, content.len() as u64, &content)
        };
        let message = framed(MESSAGE, 1, b"x");
        let whole = [&good[..], &message].concat();
        for same in [
            message.clone(),
            chunk(&message),
            [framed(7, 1, b"x"), message].concat(),
        ] {
            assert_eq!(sound(&[&good[..], &same].concat()), whole);
        }
        for bad in [
            framed(MESSAGE, u64::MAX, b"abc"),
            framed(MESSAGE, 4, b"abc"),
            framed(HEADER, 8, &[0, 0, 0, 0, 1, 0, 0, 0]),
            framed(SCHEMA, 6, &[0, 0, 0xCC, 0xCC, 0xCC, 0xCC]),
            framed(
                CHANNEL,
                16,
                &[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0],
            ),
            chunk(&framed(MESSAGE, u64::MAX - 3, b"x")),
            chunk(&framed(MESSAGE, 2, b"x")),
        ] {
            assert_eq!(sound(&[&good[..], &bad].concat()), good);
        }
    }
}

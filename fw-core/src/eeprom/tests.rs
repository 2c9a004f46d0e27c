use super::*;

#[test]
fn the_first_board_is_accepted_and_comes_back() {
    let config = first_board();
    check(&config).unwrap();
    let mut image = [0xFF; IMAGE_LEN];
    encode(&config, &mut image);
    assert_eq!(decode(&image).unwrap(), config);
    encode_original(&config, &mut image);
    assert_eq!(decode(&image).unwrap(), config);
}

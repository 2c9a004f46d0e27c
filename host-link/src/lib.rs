//! The Raspberry Pi side: EEPROM, SPI link, drive and map, over embedded-hal.

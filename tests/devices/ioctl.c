// The Pi's device files without their hardware, for tests: loaded before the C library (LD_PRELOAD), it passes
// what spidev, i2c-dev and the GPIO character device are asked for, as the kernel's headers define it, to the
// Unix socket that ROBOT_DEVICES names, and its answers back. The device files may be any files; a GPIO chip's
// holds the chip's label. Protocol, all numbers 32 bits: kind, number, length, bytes; errno, length, bytes.
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <linux/spi/spidev.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

enum { LINES = 54, FILES = 1024, LONGEST = 65536 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int connection = -1;
// The line of each file that is a line's handle, and one.
static uint32_t line_of[FILES];
static unsigned char message[LONGEST];
static uint32_t length;

static void put(const void *from, uint32_t count) {
    if (from && length + count <= LONGEST) {
        memcpy(message + length, from, count);
    }
    length += count;
}

static void put_number(uint32_t number) { put(&number, sizeof number); }

static int all(ssize_t (*act)(int, void *, size_t, int), void *bytes, size_t count) {
    for (size_t done = 0; done < count;) {
        ssize_t some = act(connection, (char *)bytes + done, count - done, MSG_NOSIGNAL);
        if (some <= 0) {
            return -1;
        }
        done += (size_t)some;
    }
    return 0;
}

static ssize_t sending(int fd, void *bytes, size_t count, int flags) { return send(fd, bytes, count, flags); }

static int connected(void) {
    const char *path = getenv("ROBOT_DEVICES");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (connection >= 0) {
        return 0;
    }
    if (!path || strlen(path) >= sizeof address.sun_path) {
        return -1;
    }
    strcpy(address.sun_path, path);
    connection = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    return connect(connection, (struct sockaddr *)&address, sizeof address);
}

// Asks with the bytes that were put; leaves the answer's in their place. What an ioctl returns.
static int ask(char kind, uint32_t number) {
    uint32_t question[3] = {(uint32_t)kind, number, length}, answer[2];
    if (length > LONGEST || connected() || all(sending, question, sizeof question) ||
        all(sending, message, length) || all(recv, answer, sizeof answer) || answer[1] > LONGEST ||
        all(recv, message, answer[1])) {
        errno = ENODEV;
        return -1;
    }
    length = answer[1];
    errno = (int)answer[0];
    return answer[0] ? -1 : 0;
}

static int spi_message(struct spi_ioc_transfer *transfers, uint32_t count) {
    for (uint32_t at = 0; at < count; at++) {
        const struct spi_ioc_transfer *one = &transfers[at];
        put_number(one->len);
        put_number(one->delay_usecs);
        put_number(one->cs_change);
        put((const void *)(uintptr_t)one->tx_buf, one->len);
    }
    if (ask('S', count)) {
        return -1;
    }
    uint32_t from = 0;
    for (uint32_t at = 0; at < count; from += transfers[at++].len) {
        if (transfers[at].rx_buf) {
            memcpy((void *)(uintptr_t)transfers[at].rx_buf, message + from, transfers[at].len);
        }
    }
    return (int)from;
}

static int i2c_messages(struct i2c_rdwr_ioctl_data *data) {
    for (uint32_t at = 0; at < data->nmsgs; at++) {
        const struct i2c_msg *one = &data->msgs[at];
        put_number(one->addr);
        put_number(one->flags);
        put_number(one->len);
        put(one->buf, one->len);
    }
    if (ask('I', data->nmsgs)) {
        return -1;
    }
    uint32_t from = 0;
    for (uint32_t at = 0; at < data->nmsgs; from += data->msgs[at++].len) {
        if (data->msgs[at].flags & I2C_M_RD) {
            memcpy(data->msgs[at].buf, message + from, data->msgs[at].len);
        }
    }
    return (int)data->nmsgs;
}

static int chip_info(int chip, struct gpiochip_info *info) {
    memset(info, 0, sizeof *info);
    info->lines = LINES;
    return pread(chip, info->label, sizeof info->label - 1, 0) > 0 ? 0 : -1;
}

static int line_info(struct gpioline_info *info) {
    uint32_t line = info->line_offset;
    memset(info, 0, sizeof *info);
    info->line_offset = line;
    return 0;
}

static int line_handle(int chip, struct gpiohandle_request *request) {
    char label[8] = "";
    if (pread(chip, label, sizeof label - 1, 0) < 0 || strcmp(label, "pinctrl") != 0) {
        errno = EPERM;
        return -1;
    }
    put_number(request->flags);
    put_number(request->default_values[0]);
    if (request->lines != 1 || ask('L', request->lineoffsets[0])) {
        return -1;
    }
    request->fd = fcntl(chip, F_DUPFD_CLOEXEC, 0);
    line_of[request->fd] = request->lineoffsets[0] + 1;
    return 0;
}

static int line_values(int handle, struct gpiohandle_data *data, char kind) {
    put_number(data->values[0]);
    int failed = ask(kind, line_of[handle] - 1);
    data->values[0] = message[0];
    return failed;
}

static int answer(int fd, unsigned long request, void *argument) {
    length = 0;
    if (_IOC_TYPE(request) == SPI_IOC_MAGIC && _IOC_NR(request) == 0) {
        return spi_message(argument, _IOC_SIZE(request) / sizeof(struct spi_ioc_transfer));
    }
    switch (request) {
    case SPI_IOC_WR_MODE:
        return ask('M', *(uint8_t *)argument);
    case SPI_IOC_WR_BITS_PER_WORD:
        return ask('B', *(uint8_t *)argument);
    case SPI_IOC_WR_MAX_SPEED_HZ:
        return ask('H', *(uint32_t *)argument);
    case I2C_SLAVE:
    case I2C_PEC:
        return 0;
    case I2C_RDWR:
        return i2c_messages(argument);
    case GPIO_GET_CHIPINFO_IOCTL:
        return chip_info(fd, argument);
    case GPIO_GET_LINEINFO_IOCTL:
        return line_info(argument);
    case GPIO_GET_LINEHANDLE_IOCTL:
        return line_handle(fd, argument);
    case GPIOHANDLE_GET_LINE_VALUES_IOCTL:
        return line_values(fd, argument, 'G');
    case GPIOHANDLE_SET_LINE_VALUES_IOCTL:
        return line_values(fd, argument, 'P');
    default:
        return (int)syscall(SYS_ioctl, fd, request, argument);
    }
}

int ioctl(int fd, unsigned long request, ...) {
    va_list more;
    va_start(more, request);
    void *argument = va_arg(more, void *);
    va_end(more);
    pthread_mutex_lock(&lock);
    int result = answer(fd, request, argument);
    int cause = errno;
    pthread_mutex_unlock(&lock);
    errno = cause;
    return result;
}

// Names the file or folder before it syncs it.
int fsync(int fd) {
    char link[32], name[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t count = readlink(link, name, sizeof name);
    pthread_mutex_lock(&lock);
    length = 0;
    put(name, count > 0 ? (uint32_t)count : 0);
    ask('F', 0);
    pthread_mutex_unlock(&lock);
    return (int)syscall(SYS_fsync, fd);
}

int close(int fd) {
    if (fd >= 0 && fd < FILES && line_of[fd]) {
        pthread_mutex_lock(&lock);
        length = 0;
        ask('R', line_of[fd] - 1);
        line_of[fd] = 0;
        pthread_mutex_unlock(&lock);
    }
    return (int)syscall(SYS_close, fd);
}

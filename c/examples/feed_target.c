/* The replay on a Cortex-M4F: vectors, start-up, and the debugger's host by semihosting. The feed is feed.bin in the folder that the
 * debugger was started in. */

#include <stdint.h>

#include "feed_io.h"

/* By the linker script. */
extern uint32_t stack_top[];
extern uint32_t data_begin[];
extern uint32_t data_end[];
extern const uint32_t data_stored[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];

/* Semihosting calls, modes and reasons. */
enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT = 0x18 };
enum { READ_BINARY = 1, WRITE = 4 };
enum { APPLICATION_EXIT = 0x20026, RUN_TIME_ERROR = 0x20023 };

#define PAINT 0xcccccccc
/* Left unpainted below the stack pointer: the painter's own frame. */
#define MARGIN_BYTES 256
/* Bytes above the static variables that the stack must leave alone. */
#define GUARD_BYTES 1024

static intptr_t call_host(int call, uintptr_t argument) {
  register intptr_t r0 __asm__("r0") = call;
  register uintptr_t r1 __asm__("r1") = argument;
  __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

static intptr_t open_file(const char *name, size_t length, uintptr_t mode) {
  const uintptr_t arguments[] = {(uintptr_t)name, mode, length};
  return call_host(SYS_OPEN, (uintptr_t)arguments);
}

static _Noreturn void end(uintptr_t reason) {
  for (;;) {
    call_host(SYS_EXIT, reason);
  }
}

bool feed_read(void *bytes, size_t length) {
  static intptr_t feed = -1;
  if (feed == -1) {
    feed = open_file("feed.bin", 8, READ_BINARY);
  }
  const uintptr_t arguments[] = {(uintptr_t)feed, (uintptr_t)bytes, length};
  return feed != -1 && call_host(SYS_READ, (uintptr_t)arguments) == 0;
}

void text_write(const char *text, size_t length) {
  static intptr_t console = -1;
  if (console == -1) {
    console = open_file(":tt", 3, WRITE);
  }
  const uintptr_t arguments[] = {(uintptr_t)console, (uintptr_t)text, length};
  call_host(SYS_WRITE, (uintptr_t)arguments);
}

/* Volatile: the stack is written to behind the compiler's back. */
static void paint_stack(void) {
  const uint32_t *const here = __builtin_frame_address(0);
  for (volatile uint32_t *word = bss_end; word < here - MARGIN_BYTES / 4; ++word) {
    *word = PAINT;
  }
}

size_t stack_used(void) {
  const volatile uint32_t *word = bss_end;
  while (word < stack_top && *word == PAINT) {
    ++word;
  }
  if ((uintptr_t)word < (uintptr_t)bss_end + GUARD_BYTES) {
    text_write("error the stack is used up\n", 27);
    end(RUN_TIME_ERROR);
  }
  return (size_t)((uintptr_t)stack_top - (uintptr_t)word);
}

static void fault(void) {
  /* A fresh stack: the fault may be that the old one left the memory. */
  __asm__ volatile("mov sp, %0" : : "r"(stack_top));
  text_write("error fault of the processor\n", 29);
  end(RUN_TIME_ERROR);
}

static _Noreturn void run(void) {
  for (uint32_t *word = bss_begin; word < bss_end; ++word) {
    *word = 0;
  }
  const uint32_t *stored = data_stored;
  for (uint32_t *word = data_begin; word < data_end; ++word) {
    *word = *stored++;
  }
  paint_stack();
  end(replay() == 0 ? APPLICATION_EXIT : RUN_TIME_ERROR);
}

/* Before anything that may use the registers of the floating-point unit: full access to it. */
__attribute__((naked)) static void reset(void) {
  __asm__ volatile(
      "ldr r0, =0xe000ed88\n"
      "ldr r1, [r0]\n"
      "orr r1, r1, #0x00f00000\n"
      "str r1, [r0]\n"
      "dsb\n"
      "isb\n"
      "b %c0\n"
      ".ltorg\n"
      :
      : "i"(run));
}

/* The first sixteen; the program enables no interrupt. */
__attribute__((section(".vectors"), used)) const uintptr_t vectors[16] = {
    (uintptr_t)stack_top, (uintptr_t)reset, (uintptr_t)fault, (uintptr_t)fault, (uintptr_t)fault,
    (uintptr_t)fault,     (uintptr_t)fault,
};

/* The replay on a host: the feed is the file named, or feed.bin. */

#include <stdio.h>

#include "feed_io.h"

static FILE *feed;

bool feed_read(void *bytes, size_t length) { return fread(bytes, 1, length, feed) == length; }

void text_write(const char *text, size_t length) { fwrite(text, 1, length, stdout); }

size_t stack_used(void) { return 0; }

int main(int argc, char **argv) {
  const char *name = argc > 1 ? argv[1] : "feed.bin";
  feed = fopen(name, "rb");
  if (feed == NULL) {
    perror(name);
    return 1;
  }
  return replay();
}

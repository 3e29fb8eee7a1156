/* What Windows wants of a function with a large frame: every page of the stack is touched in turn, from the top, so that
 * the system can add to it. rax holds the size of the frame; no register may change. With it the library needs nothing
 * of the compiler's own runtime, which would come whole and be the larger part of the file. */

#if defined(_WIN64) && defined(__x86_64__)
__asm__(".globl ___chkstk_ms\n"
        "___chkstk_ms:\n"
        "  push %rax\n"
        "  push %r11\n"
        "  neg %rax\n"
        "  lea 24(%rsp, %rax), %r11\n" /* the end of the frame */
        "  lea 24(%rsp), %rax\n"
        "1:\n"
        "  sub $4096, %rax\n"
        "  cmp %r11, %rax\n"
        "  jb 2f\n"
        "  test %al, (%rax)\n"
        "  jmp 1b\n"
        "2:\n"
        "  test %al, (%r11)\n"
        "  pop %r11\n"
        "  pop %rax\n"
        "  ret\n");
#endif
